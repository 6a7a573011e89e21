//! `video`: figures of generated frames, with a bar of rollouts done; pairs with the reference camera; first frames from
//! layout and prompt.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use ds_camera::{Appearance, ReferenceWorld};
use ds_evaluate::arm::Arm;
use ds_evaluate::drive::{Drive, Route};
use ds_evaluate::evaluation::{Evaluation, Part};
use ds_evaluate::outcome::Outcome;
use ds_evaluate::pairs::PairsPlan;
use ds_evaluate::{EvalConfig, Progress, report};
use ds_process::terminal::{answer, bar, note};
use ds_raster::Encoding;
use ds_second_camera::SecondWorld;
use ds_space::Draws;
use ds_topic::ObservationSource;
use ds_train::first_frame::{FirstFrames, Request};
use ds_video::ModelConfig;
use ds_world::Wording;
use indicatif::ProgressBar;

use crate::cli::{FirstFrameArgs, PairsArgs, VideoCommand, VideoEvalArgs};

/// A bar of rollouts or sets done.
pub(crate) struct Bar(pub(crate) ProgressBar);

impl Progress for Bar {
    fn ahead(&mut self, rollouts: u64) {
        self.0.inc_length(rollouts);
    }

    fn done(&mut self, what: &str, stored: bool) {
        self.0.set_message(if stored { format!("{what} (kept)") } else { what.to_owned() });
        self.0.inc(1);
    }

    fn note(&mut self, text: &str) {
        self.0.println(text);
    }
}

/// Runs a command of `video`.
///
/// # Errors
/// If a file cannot be used or a rollout fails.
pub(crate) fn run(command: &VideoCommand) -> Result<()> {
    match command {
        VideoCommand::Eval(args) => eval(args),
        VideoCommand::Pairs(args) => pairs(args),
        VideoCommand::FirstFrame(args) => first_frame(args),
    }
}

fn first_frame(args: &FirstFrameArgs) -> Result<()> {
    let (scene, _warnings) = ds_scenario::load(&args.scenario)?;
    let weights = args.weights.display();
    ensure!(args.weights.exists(), "there are no weights {weights}");
    let preset = ModelConfig::load(&args.model).with_context(|| format!("model {}", args.model.display()))?;
    let wording = args.prompt.as_deref().map(Wording::read).unwrap_or_default();
    let look = wording.condition().map_or(Appearance::DAY, |condition| Appearance::condition(condition, 0));
    let route = Route { scene: Arc::new(scene), start: 0, pace: 1.0, look, turned_deg: 0.0 };
    let mut drive = Drive::new(&ReferenceWorld, &route, (preset.video.width_px, preset.video.height_px))?;
    let layout = drive.layout(0)?;
    note(&format!("prompt: {}", drive.prompt));
    let remarks = args.prompt.iter().flat_map(|_| wording.remarks());
    remarks.for_each(|remark| note(&format!("--prompt: {remark}")));
    let request = Request {
        layout: &layout,
        prompt: &drive.prompt,
        key: Draws::key(&drive.draw_key, "first frame", args.seed),
        steps: usize::from(args.steps),
        guidance: args.guidance,
    };
    let maker = FirstFrames::load(&preset, &args.weights).with_context(|| format!("weights {weights}"))?;
    let frame = maker.make(&request)?;
    if let Some(folder) = args.out.parent() {
        std::fs::create_dir_all(folder).with_context(|| format!("create {}", folder.display()))?;
    }
    std::fs::write(&args.out, frame.encode(Encoding::Png)?).with_context(|| format!("write {}", args.out.display()))?;
    answer(&args.out.display().to_string());
    Ok(())
}

fn pairs(args: &PairsArgs) -> Result<()> {
    let plan = PairsPlan {
        first_seed: args.first_seed,
        clips: args.clips,
        seeds: args.seeds,
        first: args.first,
        frames: args.frames,
        look: args.look.clone(),
        over: args.over,
    };
    plan.check()?;
    let arm = Arm::of_source(ObservationSource::Dreamstream, &args.model, &args.weights, &args.weights)?;
    let bar = bar(args.cases, "cases");
    for case in 0..args.cases {
        let folder = args.out.join(format!("case_{case:03}"));
        ds_evaluate::pairs::write(&ReferenceWorld, &arm, &plan, case, &folder)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    answer(&args.out.display().to_string());
    Ok(())
}

fn eval(args: &VideoEvalArgs) -> Result<()> {
    let config = EvalConfig::load(&args.config).with_context(|| format!("configuration {}", args.config.display()))?;
    let mut config = if args.quick { config.quick() } else { config };
    if let Some(out) = &args.out {
        config.out.clone_from(out);
    }
    if args.quick {
        config.out = config.out.join("quick");
    }
    let parts: BTreeSet<Part> = match args.only.as_slice() {
        [] => Part::ALL.into_iter().collect(),
        only => only.iter().copied().collect(),
    };
    let mut outcome = if args.only.is_empty() { Outcome::default() } else { report::earlier(&config.out)? };
    outcome.quick = args.quick;
    let began = Instant::now();
    let seconds = || began.elapsed().as_secs_f64();
    let mut progress = Bar(bar(0, "rollouts"));
    for part in parts {
        // A part that is done is written, so that an interruption loses no more than the one under way.
        let mut evaluation = Evaluation::open(&config, &[&ReferenceWorld, &SecondWorld], &mut progress)?;
        evaluation.measure(&mut outcome, &BTreeSet::from([part]), &seconds)?;
        report::write(&outcome, &config)?;
    }
    progress.0.finish_and_clear();
    for name in ["eval.json", "index.html"] {
        answer(&config.out.join(name).display().to_string());
    }
    Ok(())
}
