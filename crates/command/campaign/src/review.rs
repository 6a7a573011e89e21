//! `review`: a set of variants → a page with each encounter from above, and verdicts of people beside the manifest.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use ds_adverse::{BrokenRules, Course, broken_rules};
use ds_benchmark::quality::Severity;
use ds_benchmark::review::page::{Card, page};
use ds_benchmark::{Entry, Kind, Quality, Review, Verdicts, file};
use ds_process::terminal::{answer, bar};
use ds_space::Tick;
use ds_world::Scene;
use rayon::prelude::*;

use crate::cli::ReviewArgs;
use crate::{Ended, above, ask};

/// How long an animation goes on after the contact, in ticks.
const AFTER_TICKS: u32 = 15;
/// Digits of the adversary's digest in the name of its animation.
const DIGITS: usize = 16;

/// Runs `review`.
///
/// # Errors
/// If the set is of another kind, a verdict is none, a scenario is not the one that is meant, or a file cannot be written.
pub(crate) fn run(args: &ReviewArgs) -> Result<Ended> {
    let (sets, folders) = ask::manifests(std::slice::from_ref(&args.manifest))?;
    let (set, folder) = (&sets[0], &folders[0]);
    ensure!(set.kind == Kind::Behavior, "{} is of kind {:?}, not behavior", args.manifest.display(), set.kind);
    if !args.accept.is_empty() || !args.reject.is_empty() {
        let reject: Vec<(String, String)> = args.reject.iter().map(|text| named(text)).collect();
        let mut verdicts = Verdicts::of(folder, set, &args.reviewer)?;
        verdicts.take(set, &args.accept, &reject)?;
        verdicts.save(folder, set)?;
        answer(&format!("verdicts: {}", Verdicts::path(folder, set, &args.reviewer).display()));
    }
    let review = Review::beside(folder, set)?;
    let out = folder.join(format!("{}.review", set.name));
    std::fs::create_dir_all(&out).with_context(|| format!("create {}", out.display()))?;
    let bar = bar(set.entries.len() as u64, "variants");
    let quality = Quality::beside(folder, set)?;
    let severity = |entry: &Entry| quality.as_ref().and_then(|quality| quality.variants.get(&entry.name).copied());
    let cards = set.entries.par_iter().map(|entry| {
        let card = card(entry, severity(entry), folder, &out).with_context(|| format!("entry {:?}", entry.name));
        bar.inc(1);
        card
    });
    let cards: Vec<Card> = cards.collect::<Result<_>>()?;
    bar.finish_and_clear();
    let path = out.join("review.html");
    let manifest = args.manifest.file_name().unwrap_or_default().to_string_lossy();
    file::write(page(set, &review, &cards, &manifest).as_bytes(), &path)?;
    answer(&review.told(set));
    answer(&format!("page: {}", path.display()));
    Ok(Ended::Complete)
}

/// Reads `NAME=REASON`; without a reason it is empty, which is refused with the name.
fn named(text: &str) -> (String, String) {
    let (name, reason) = text.split_once('=').unwrap_or((text, ""));
    (name.to_owned(), reason.to_owned())
}

/// Drives the log of a variant and draws it, unless that adversary was drawn before.
fn card<'a>(entry: &'a Entry, severity: Option<Severity>, folder: &Path, out: &Path) -> Result<Card<'a>> {
    let scene = Arc::new(entry.scene(folder)?);
    let course = Course::of(&scene, Tick(entry.last)).context("the scenario has no adversary")?;
    let attack = scene.adversary.as_ref().map_or(0, |adversary| adversary.attack.0);
    let digest: String = entry.adversary_digest.as_deref().unwrap_or("none").chars().take(DIGITS).collect();
    let picture = format!("{}.{digest}.gif", entry.name);
    let path = out.join(&picture);
    if !path.exists() {
        animate(&scene, &course, entry, &path)?;
    }
    let contact = course.contact.map(|(tick, contact)| (tick.0, contact.closing_speed_mps));
    let broken = broken(&broken_rules(&scene).unwrap_or_default(), scene.dt.secs(), entry);
    Ok(Card { entry, picture, dt_secs: scene.dt.secs(), attack, contact, ttc_secs: course.ttc_secs, broken, severity })
}

/// Returns which traffic rules an adversary breaks, in words.
fn broken(rules: &BrokenRules, dt_secs: f64, entry: &Entry) -> String {
    let red = rules.red_light.map(|tick| {
        let secs = (f64::from(tick.0) - f64::from(entry.hand_over)) * dt_secs;
        format!("crosses a red light {secs:.1} s after the hand-over")
    });
    let wrong = (rules.wrong_way_m > 0.0).then(|| format!("drives {:.1} m against the traffic", rules.wrong_way_m));
    let words: Vec<String> = red.into_iter().chain(wrong).collect();
    if words.is_empty() { "none".to_owned() } else { words.join(", ") }
}

/// Draws the course from the hand-over to a while after the contact.
fn animate(scene: &Scene, course: &Course, entry: &Entry, path: &Path) -> Result<()> {
    let last = course.contact.map_or(entry.last, |(tick, _)| entry.last.min(tick.0 + AFTER_TICKS)) as usize;
    above::animate(scene, &course.states[entry.hand_over as usize..=last], path)
}
