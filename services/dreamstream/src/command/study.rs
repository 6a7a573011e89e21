//! `study`: tables over held-out scenarios, with a bar of what is done.

use std::time::Instant;

use anyhow::{Context, Result};
use ds_evaluate::study::outcome::Outcome;
use ds_evaluate::study::{self, FidelityConfig};

use crate::cli::{FidelityArgs, StudyCommand};
use crate::command::video::Bar;
use crate::command::{answer, bar};

/// Runs a command of `study`.
///
/// # Errors
/// If a file cannot be used or frames cannot be made.
pub(crate) fn run(command: &StudyCommand) -> Result<()> {
    match command {
        StudyCommand::Fidelity(args) => fidelity(args),
    }
}

fn fidelity(args: &FidelityArgs) -> Result<()> {
    let mut config =
        FidelityConfig::load(&args.config).with_context(|| format!("configuration {}", args.config.display()))?;
    if let Some(out) = &args.out {
        config.out.clone_from(out);
    }
    config.scenarios = args.scenarios.unwrap_or(config.scenarios);
    config.check()?;
    if args.quick {
        config = config.quick();
    }
    let began = Instant::now();
    let mut progress = Bar(bar(0, "sets"));
    let mut outcome = study::fidelity(&config, &mut progress, &|| began.elapsed().as_secs_f64())?;
    outcome.quick = args.quick;
    study::write(&config, &outcome)?;
    progress.0.finish_and_clear();
    said(&outcome);
    for name in ["fidelity.json", "index.html"] {
        answer(&config.out.join(name).display().to_string());
    }
    Ok(())
}

fn said(outcome: &Outcome) {
    answer(&format!("× 100, 95 % intervals over {} scenarios; {}", outcome.scenarios, outcome.kind));
    for (name, figure) in &outcome.fd_pi {
        answer(&format!("FDpi {name}: {:.2} [{:.2}, {:.2}]", figure.value, figure.low, figure.high));
    }
    for (name, table) in outcome.policies.iter().chain(&outcome.others) {
        for (source, row) in &table.sources {
            let figure = row.fd;
            answer(&format!(
                "  {name} {source}: {:.2} [{:.2}, {:.2}], bias of independent sets {:.2}{}",
                figure.value,
                figure.low,
                figure.high,
                row.bias,
                row.warnings.iter().map(|warning| format!("; {warning}")).collect::<String>()
            ));
        }
    }
    for ratio in &outcome.ratios {
        let text = ratio.ratio.map_or_else(
            || "none, a value is not above zero".to_owned(),
            |r| format!("{:.2} [{:.2}, {:.2}]", r.value, r.low, r.high),
        );
        answer(&format!("{} / {}: {text}", ratio.above, ratio.below));
    }
}
