//! `video eval`: figures of generated frames, with a bar of rollouts done.

use std::collections::BTreeSet;
use std::time::Instant;

use anyhow::{Context, Result};
use ds_appraisal::column::WorldB;
use ds_appraisal::evaluation::{Evaluation, Part};
use ds_appraisal::outcome::Outcome;
use ds_appraisal::{EvalConfig, Progress, report};
use ds_perception::world::WorldA;
use indicatif::ProgressBar;

use crate::cli::{VideoCommand, VideoEvalArgs};
use crate::command::{answer, bar};

struct Bar(ProgressBar);

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
    }
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
        only => only.iter().map(|name| name.part()).collect(),
    };
    let mut outcome = if args.only.is_empty() { Outcome::default() } else { report::earlier(&config.out)? };
    outcome.quick = args.quick;
    let began = Instant::now();
    let seconds = || began.elapsed().as_secs_f64();
    let mut progress = Bar(bar(0, "rollouts"));
    for part in parts {
        // A part that is done is written, so that an interruption loses no more than the one under way.
        let mut evaluation = Evaluation::open(&config, &[&WorldA, &WorldB], &mut progress)?;
        evaluation.measure(&mut outcome, &BTreeSet::from([part]), &seconds)?;
        report::write(&outcome, &config)?;
    }
    progress.0.finish_and_clear();
    for name in ["eval.json", "index.html"] {
        answer(&config.out.join(name).display().to_string());
    }
    Ok(())
}
