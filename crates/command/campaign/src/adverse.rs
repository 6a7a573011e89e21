//! `scenario adverse`: scenarios → variants with an adversary, their files, and one report of what came out and why not.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use ds_adverse::{
    Apart, Built, MotionModel, Options, Quality, Refusal, Resemblance, Solution, Variant, broken_rules, quality,
};
use ds_process::terminal::{answer, bar};
use ds_space::Tick;
use ds_world::{CrashClass, Scene};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::cli::adverse::AdverseArgs;

/// The name of the report.
const REPORT: &str = "adverse.json";

#[derive(Debug, Serialize)]
struct Report {
    format: &'static str,
    version: u32,
    seed: u64,
    hand_over: u32,
    mode: &'static str,
    arm: &'static str,
    model_transitions: u64,
    scenarios: Vec<ScenarioPart>,
    /// Sums over all scenarios, by class.
    classes: BTreeMap<&'static str, ClassPart>,
    /// How adversaries compare with the logged vehicles beside them.
    quality: QualityPart,
}

#[derive(Debug, Serialize)]
struct QualityPart {
    noise_m: f64,
    motion: BTreeMap<&'static str, [Option<ApartPart>; 2]>,
    telling_area: Option<f64>,
    telling_interval: Option<[f64; 2]>,
    starts_apart_m: Option<f64>,
    start_sectors: usize,
    contact_sectors: usize,
}

/// How far a quantity of motion is from the logged one: before the attack, then in it.
#[derive(Debug, Clone, Copy, Serialize)]
struct ApartPart {
    values: usize,
    divergence_nats: f64,
    floor_nats: f64,
    shift: f64,
    outside: f64,
}

impl QualityPart {
    fn of(quality: &Quality) -> Self {
        let part = |apart: Apart| ApartPart {
            values: apart.values,
            divergence_nats: apart.divergence_nats,
            floor_nats: apart.floor_nats,
            shift: apart.shift,
            outside: apart.outside,
        };
        let of = |it: &Resemblance| (it.quantity, [it.before.map(part), it.attack.map(part)]);
        Self {
            noise_m: quality.noise_m,
            motion: quality.resemblances.iter().map(of).collect(),
            telling_area: quality.telling.map(|telling| telling.area),
            telling_interval: quality.telling.map(|telling| telling.interval),
            starts_apart_m: quality.spread.starts_apart_m,
            start_sectors: quality.spread.start_sectors,
            contact_sectors: quality.spread.contact_sectors,
        }
    }
}

#[derive(Debug, Serialize)]
struct ScenarioPart {
    name: String,
    digest: String,
    /// Why nothing was searched.
    refused: Option<String>,
    variants: Vec<VariantPart>,
}

#[derive(Debug, Serialize)]
struct VariantPart {
    name: String,
    file: String,
    digest: String,
    class: &'static str,
    planned_contact_tick: u32,
    contact_tick: u32,
    face: &'static str,
    closing_mps: f64,
    delta_v_mps: f64,
    threat_tick: u32,
    least_ttc_secs: Option<f64>,
    /// Time to collision of each tick from hand-over to contact, null beyond 4 s.
    ttc_secs: Vec<Option<f64>>,
    required_deceleration_mps2: f64,
    surprise_nats_per_step: f64,
    /// The first tick at which it crosses a stop line at red.
    red_light_tick: Option<u32>,
    /// How far it drives against the traffic.
    wrong_way_m: f64,
    /// Ticks from the threat tick to the last one from which the expert still finds a drive.
    reaction_margin_ticks: Option<u32>,
    /// Ticks between the expert and the adversary at a place where both come, at the least.
    post_encroachment_ticks: Option<u32>,
    /// Whether a driver who only brakes meets nobody.
    careful_avoids: bool,
    /// The tick at which nothing is left of what an ego reaches: proof that nobody gets away, as the adversary is planned.
    unavoidable_tick: Option<u32>,
    solution: Option<SolutionPart>,
}

/// The expert's drive: the rear axle of each tick, world frame, in metres and radians.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SolutionPart {
    /// The first tick at which the ego is not on its log.
    pub from_tick: u32,
    x_m: Vec<f64>,
    y_m: Vec<f64>,
    heading_rad: Vec<f64>,
}

impl SolutionPart {
    /// Returns what a file holds of a solution.
    pub(crate) fn of(solution: &Solution) -> Self {
        Self {
            from_tick: solution.from.0,
            x_m: solution.poses.iter().map(|pose| pose.position.x).collect(),
            y_m: solution.poses.iter().map(|pose| pose.position.y).collect(),
            heading_rad: solution.poses.iter().map(|pose| pose.heading_rad).collect(),
        }
    }

    /// Says whether it is this drive, to a nanometre: files hold decimals.
    pub(crate) fn tells(&self, solution: &Solution) -> bool {
        let other = Self::of(solution);
        let near = |a: &[f64], b: &[f64]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-9);
        self.from_tick == other.from_tick
            && near(&self.x_m, &other.x_m)
            && near(&self.y_m, &other.y_m)
            && near(&self.heading_rad, &other.heading_rad)
    }
}

#[derive(Debug, Default, Serialize)]
struct ClassPart {
    variants: usize,
    candidates: usize,
    rejected: BTreeMap<&'static str, usize>,
}

/// Runs the command on scenario files, with those on which the motion model is fitted; the shipped one without any.
///
/// # Errors
/// If the folder holds an earlier search, a scenario or the fit's scenarios cannot be read, a name comes twice, or a file cannot
/// be written.
pub fn run(args: &AdverseArgs, paths: &[PathBuf], fit: &[PathBuf]) -> Result<()> {
    let path = args.out.join(REPORT);
    ensure!(!path.exists(), "an earlier search is there and stays, give another --out: {}", path.display());
    let model = model(fit, paths)?;
    let options = Options {
        hand_over: Tick(args.hand_over),
        seed: args.seed,
        mode: args.arm.mode(args.mode),
        solve: !args.unsolved,
        classes: if args.class.is_empty() { CrashClass::ALL.to_vec() } else { args.class.clone() },
        ..Options::default()
    };
    let progress = bar(paths.len() as u64, "scenarios");
    let search = |path: &PathBuf| -> Result<(Scene, Result<Built, Refusal>)> {
        let (scene, _) = ds_scenario::load(path)?;
        let built = args.arm.search(&scene, &model, &options);
        progress.inc(1);
        Ok((scene, built))
    };
    let found: Vec<(Scene, Result<Built, Refusal>)> = paths.par_iter().map(search).collect::<Result<_>>()?;
    progress.finish_and_clear();
    let mut report = Report {
        format: "dreamstream-adverse",
        version: 1,
        seed: args.seed,
        hand_over: args.hand_over,
        mode: options.mode.name(),
        arm: args.arm.name(),
        model_transitions: model.transitions(),
        scenarios: Vec::new(),
        classes: options.classes.iter().map(|class| (class.name(), ClassPart::default())).collect(),
        quality: QualityPart::of(&compared(&found)),
    };
    for (scene, built) in &found {
        let twice = report.scenarios.iter().any(|part| part.name == scene.name);
        ensure!(!twice, "two of the scenarios are named {:?}", scene.name);
        report.scenarios.push(written(scene, built, &args.out, &mut report.classes)?);
    }
    std::fs::create_dir_all(&args.out).with_context(|| format!("cannot make {}", args.out.display()))?;
    let text = serde_json::to_string_pretty(&report).context("report as JSON")? + "\n";
    std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
    tell(&report, &args.out);
    Ok(())
}

/// Compares what was found with the logged vehicles of all scenarios.
pub(crate) fn compared(found: &[(Scene, Result<Built, Refusal>)]) -> Quality {
    let all: Vec<(&Scene, &[Variant])> = found
        .iter()
        .map(|(scene, built)| (scene, built.as_ref().map_or(&[][..], |built| &built.variants[..])))
        .collect();
    quality(&all)
}

/// Returns the shipped model, or one fitted on scenarios of which none is varied.
fn model(fit: &[PathBuf], varied: &[PathBuf]) -> Result<MotionModel> {
    if fit.is_empty() {
        return Ok(MotionModel::town());
    }
    if let Some(both) = fit.iter().find(|path| varied.contains(path)) {
        anyhow::bail!("the motion model may not be fitted on a scenario that is varied: {}", both.display());
    }
    let scenes: Vec<Scene> = fit.iter().map(|path| Ok(ds_scenario::load(path)?.0)).collect::<Result<_>>()?;
    let model = MotionModel::fit(&scenes);
    ensure!(model.transitions() > 0, "no vehicle moves in the {} scenarios of --fit", scenes.len());
    Ok(model)
}

fn written(
    scene: &Scene,
    built: &Result<Built, Refusal>,
    out: &Path,
    classes: &mut BTreeMap<&'static str, ClassPart>,
) -> Result<ScenarioPart> {
    let mut part = ScenarioPart {
        name: scene.name.clone(),
        digest: scene.digest.to_string(),
        refused: None,
        variants: Vec::new(),
    };
    match built {
        Err(refusal) => part.refused = Some(refusal.to_string()),
        Ok(built) => {
            for variant in &built.variants {
                let file = format!("{}{}", variant.scene.name, ds_scenario::store::SUFFIX);
                ds_scenario::save(&variant.scene, &out.join(&file))?;
                part.variants.push(described(variant, file));
                classes.entry(variant.class.name()).or_default().variants += 1;
            }
            for ((class, reason), count) in &built.rejected {
                *classes.entry(class.name()).or_default().rejected.entry(reason.name()).or_default() += count;
            }
            for (class, count) in &built.candidates {
                classes.entry(class.name()).or_default().candidates += count;
            }
        }
    }
    Ok(part)
}

fn described(variant: &Variant, file: String) -> VariantPart {
    let measures = &variant.measures;
    let broken = broken_rules(&variant.scene).unwrap_or_default();
    VariantPart {
        name: variant.scene.name.clone(),
        file,
        digest: variant.scene.digest.to_string(),
        class: variant.class.name(),
        planned_contact_tick: variant.planned.0,
        contact_tick: measures.met.tick.0,
        face: match measures.met.face {
            ds_world::ContactKind::Front => "front",
            ds_world::ContactKind::Side => "side",
            ds_world::ContactKind::Rear => "rear",
        },
        closing_mps: measures.met.closing_mps,
        delta_v_mps: measures.delta_v_mps,
        threat_tick: measures.threat.0,
        least_ttc_secs: measures.least_ttc_secs(),
        ttc_secs: measures.ttc_secs.clone(),
        required_deceleration_mps2: measures.required_mps2,
        surprise_nats_per_step: variant.surprise,
        red_light_tick: broken.red_light.map(|tick| tick.0),
        wrong_way_m: broken.wrong_way_m,
        reaction_margin_ticks: variant.margin_ticks,
        post_encroachment_ticks: variant.solution.as_ref().and_then(|solution| solution.post_encroachment_ticks),
        careful_avoids: variant.careful,
        unavoidable_tick: variant.emptied.map(|tick| tick.0),
        solution: variant.solution.as_ref().map(SolutionPart::of),
    }
}

fn tell(report: &Report, out: &Path) {
    for part in &report.scenarios {
        let classes: Vec<&str> = part.variants.iter().map(|variant| variant.class).collect();
        let said = part.refused.clone().unwrap_or_else(|| classes.join(", "));
        answer(&format!("{:<34} {}", part.name, if said.is_empty() { "no variant" } else { &said }));
    }
    for (class, part) in &report.classes {
        let reasons: Vec<String> = part.rejected.iter().map(|(reason, count)| format!("{reason} {count}")).collect();
        let why = if reasons.is_empty() { "nothing".to_owned() } else { reasons.join(", ") };
        answer(&format!("{class}: {} variants of {} candidates; rejected: {why}", part.variants, part.candidates));
    }
    tell_quality(&report.quality);
    let with = report.scenarios.iter().filter(|part| !part.variants.is_empty()).count();
    let refused = report.scenarios.iter().filter(|part| part.refused.is_some()).count();
    let count = report.scenarios.len();
    answer(&format!(
        "{with} of {count} scenarios have a variant, {refused} were not searched; {}",
        out.join(REPORT).display()
    ));
}

fn tell_quality(quality: &QualityPart) {
    let against = |apart: &Option<ApartPart>| {
        apart.map_or("none".to_owned(), |apart| {
            let (divergence, floor, outside) = (apart.divergence_nats, apart.floor_nats, 100.0 * apart.outside);
            format!("{divergence:.3} nats (floor {floor:.3}), {outside:.1} % outside")
        })
    };
    for (quantity, [before, attack]) in &quality.motion {
        answer(&format!("{quantity}: before the attack {}; in it {}", against(before), against(attack)));
    }
    let number = |value: Option<f64>| value.map_or("none".to_owned(), |value| format!("{value:.2}"));
    answer(&format!(
        "told from logged vehicles: area {}; starts {} m apart; {} of 8 sectors at the start, {} at the contact",
        number(quality.telling_area),
        number(quality.starts_apart_m),
        quality.start_sectors,
        quality.contact_sectors,
    ));
}
