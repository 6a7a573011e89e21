//! Measures how well generated frames follow their layouts and writes JSON, a table and a contact sheet.
//!
//! `measure-layout-following --config FILE --weights FILE|FOLDER --segmenter FILE --out FOLDER [--scenarios N]
//! [--last-tick N]`; a folder is the work folder of a training, whose averaged weights so far are taken.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;
use std::process::ExitCode;

use ds_train::Progress;
use ds_train::layout_following::{Models, Span, measure, report};
use ds_train::segmenter::Segmenter;
use ds_video::ModelConfig;

const USAGE: &str = "usage: measure-layout-following --config FILE --weights FILE|FOLDER --segmenter FILE --out FOLDER \
                     [--scenarios N] [--last-tick N]";
const OPTIONS: [&str; 6] = ["--config", "--weights", "--segmenter", "--out", "--scenarios", "--last-tick"];

struct Lines;

impl Progress for Lines {
    fn step(&mut self, _step: u32, _total: u32, _loss: f32, _figures: &[(&str, f32)]) {}

    fn note(&mut self, text: &str) {
        eprintln!("{text}");
    }
}

fn options(arguments: &[String]) -> Result<BTreeMap<&str, &str>, String> {
    let mut options = BTreeMap::new();
    for pair in arguments.chunks(2) {
        let [name, value] = pair else { return Err(USAGE.to_owned()) };
        let known = OPTIONS.contains(&name.as_str());
        if !known || options.insert(name.as_str(), value.as_str()).is_some() {
            return Err(format!("option {name:?} is unknown or given twice\n{USAGE}"));
        }
    }
    Ok(options)
}

fn work(arguments: &[String]) -> Result<(), Box<dyn Error>> {
    let options = options(arguments)?;
    let path = |name: &str| options.get(name).map(Path::new).ok_or_else(|| format!("{name} is missing\n{USAGE}"));
    let config = ModelConfig::parse(&std::fs::read_to_string(path("--config")?)?)?;
    let models = Models::load(&config, path("--weights")?)?;
    let segmenter = Segmenter::load(path("--segmenter")?)?;
    let mut span = Span::default();
    if let Some(count) = options.get("--scenarios") {
        span.scenarios = count.parse().map_err(|_| format!("--scenarios {count:?} is no number"))?;
    }
    if let Some(tick) = options.get("--last-tick") {
        span.last_tick = tick.parse().map_err(|_| format!("--last-tick {tick:?} is no number"))?;
    }
    let measured = measure(&models, &segmenter, span, &mut Lines)?;
    report::write(&measured, path("--out")?)?;
    eprintln!("{}", report::as_markdown(&measured));
    Ok(())
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let Err(error) = work(&arguments) else { return ExitCode::SUCCESS };
    eprintln!("{error}");
    let mut source = error.source();
    while let Some(error) = source {
        eprintln!("  {error}");
        source = error.source();
    }
    ExitCode::FAILURE
}
