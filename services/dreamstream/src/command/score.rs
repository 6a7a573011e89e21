//! `score`: scores recordings again without simulating, or answers case files.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use ds_process::terminal::{answer, bar, complain};
use ds_record::Recording;
use ds_score::{DriveScore, DriveScorer, Profile};
use ds_space::Tick;
use ds_topic::{SceneMessage, Topic, World};
use ds_wire::Body;
use serde::Serialize;

use crate::cli::ScoreArgs;
use crate::command::recording;

/// A recording's score as it is written.
#[derive(Debug, Serialize)]
struct Scored {
    recording: String,
    /// Why the recording is not whole; absent if it is.
    #[serde(skip_serializing_if = "Option::is_none")]
    partial: Option<String>,
    scenario: String,
    policy: String,
    observation: &'static str,
    seed: u64,
    #[serde(flatten)]
    score: DriveScore,
}

/// Runs the command.
///
/// # Errors
/// If a recording or a case is refused, or the output cannot be written.
pub(crate) fn run(args: &ScoreArgs) -> Result<()> {
    match &args.cases {
        Some(folder) => cases(folder, args.out.as_deref()),
        None => recordings(args),
    }
}

fn cases(folder: &Path, out: Option<&Path>) -> Result<()> {
    let answers = ds_score_cases::answers(folder)?;
    let text = serde_json::to_string_pretty(&answers.value).context("answers as JSON")? + "\n";
    match out {
        Some(path) => write(path, &text)?,
        None => answer(text.trim_end()),
    }
    for (file, error) in &answers.failures {
        complain(&anyhow::anyhow!("{}: {error}", file.display()));
    }
    ensure!(answers.failures.is_empty(), "{} cases could not be answered", answers.failures.len());
    Ok(())
}

fn write(path: &Path, text: &str) -> Result<()> {
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).with_context(|| format!("create {}", folder.display()))?;
    }
    std::fs::write(path, text).with_context(|| format!("write {}", path.display()))?;
    answer(&format!("written to {}", path.display()));
    Ok(())
}

fn recordings(args: &ScoreArgs) -> Result<()> {
    ensure!(!args.recordings.is_empty(), "name recordings (.mcap), or a folder with --cases");
    let bar = bar(args.recordings.len() as u64, "recordings");
    let mut all = Vec::new();
    for path in &args.recordings {
        all.push(scored(path, args.profile.as_deref(), args.partial)?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    let cell = |value: Option<f64>| value.map_or_else(|| "n/a".to_owned(), |value| format!("{value:.4}"));
    answer(&format!(
        "{:<28} {:<18} {:<10} {:>13} {:>16} {:>10}",
        "scenario", "policy", "profile", "driving score", "route completion", "mean score"
    ));
    for one in &all {
        let score = &one.score;
        let values = [score.driving_score, score.route_completion, score.mean].map(cell);
        let [drive, route, mean] = &values;
        answer(&format!(
            "{:<28} {:<18} {:<10} {drive:>13} {route:>16} {mean:>10}",
            one.scenario, one.policy, score.profile
        ));
        for (term, points) in &score.lost {
            let since =
                score.first_violations.get(term).map_or(String::new(), |tick| format!(", first at tick {tick}"));
            answer(&format!("  └ {term} took {points:.4}{since}"));
        }
        if let Some((tick, ending)) = score.ended {
            answer(&format!("  └ scoring ended at tick {tick}: {ending}"));
        }
        if one.partial.is_some() {
            answer("  └ partial: of the part that could be read");
        }
        if !score.reason.is_empty() {
            answer(&format!("  └ {}", score.reason));
        }
    }
    match &args.out {
        Some(path) => write(path, &(serde_json::to_string_pretty(&all).context("scores as JSON")? + "\n")),
        None => Ok(()),
    }
}

fn scored(path: &Path, profile: Option<&str>, partial: bool) -> Result<Scored> {
    let recording = recording::open(path, partial)?;
    let scene = recording.scene();
    let score = score(&recording, scene, profile).with_context(|| path.display().to_string())?;
    let spec = &scene.spec;
    Ok(Scored {
        recording: path.display().to_string(),
        partial: recording.damage().map(str::to_owned),
        scenario: spec.scenario.clone(),
        policy: spec.policy.clone(),
        observation: spec.observation.name(),
        seed: spec.seed,
        score,
    })
}

fn score(recording: &Recording, scene: &SceneMessage, profile: Option<&str>) -> Result<DriveScore> {
    let spec = &scene.spec;
    let name = profile.unwrap_or(spec.score_profile.name());
    let profile = Profile::named(name).with_context(|| format!("there is no score profile {name:?}"))?;
    let mut states: BTreeMap<Tick, World> = BTreeMap::new();
    for envelope in recording.messages().filter(|envelope| envelope.header.slot.topic == Topic::World) {
        let world = World::from_bytes(&envelope.body)?;
        states.insert(world.state.tick, world);
    }
    let mut scorer = DriveScorer::new(&scene.scene, profile, spec.taken_over_at(), spec.last_tick);
    states.values().for_each(|world| drop(scorer.observe(&world.state)));
    Ok(scorer.finish())
}
