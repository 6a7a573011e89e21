//! Trains one perception network: `cargo run -p ds-perception --example train-perception -- NETWORK --config FILE
//! --out FILE [--work FOLDER]`, the network being `segmenter`, `lights` or `look`.
//!
//! Checkpoints go to the work folder, from which an interrupted training goes on; what the network scores on frames
//! that it has not seen is printed at the end.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;
use std::process::ExitCode;

use ds_nn::safetensors::WeightsFile;
use ds_perception::overlap::Target;
use ds_perception::training::{self, Progress, Recipe};

const USAGE: &str = "usage: train-perception segmenter|lights|look --config FILE --out FILE [--work FOLDER]";
/// Upper ends of the distances of which lights are reported apart, in metres.
const DISTANCES_M: [f64; 5] = [15.0, 30.0, 45.0, 65.0, 90.0];

struct Lines;

impl Progress for Lines {
    fn step(&mut self, step: u32, total: u32, loss: f64) {
        if step.is_multiple_of(25) {
            eprintln!("step {step}/{total} loss {loss:.4}");
        }
    }

    fn note(&mut self, text: &str) {
        eprintln!("{text}");
    }
}

fn options(arguments: &[String]) -> Result<BTreeMap<&str, &str>, String> {
    let mut options = BTreeMap::new();
    for pair in arguments.chunks(2) {
        let [name, value] = pair else { return Err(USAGE.to_owned()) };
        let known = ["--config", "--out", "--work"].contains(&name.as_str());
        if !known || options.insert(name.as_str(), value.as_str()).is_some() {
            return Err(format!("option {name:?} is unknown or given twice\n{USAGE}"));
        }
    }
    Ok(options)
}

fn work(arguments: &[String]) -> Result<(), Box<dyn Error>> {
    let (network, rest) = arguments.split_first().ok_or(USAGE)?;
    let options = options(rest)?;
    let path = |name: &str| options.get(name).map(Path::new).ok_or_else(|| format!("{name} is missing\n{USAGE}"));
    let recipe = Recipe::parse(&std::fs::read_to_string(path("--config")?)?)?;
    let folder = options.get("--work").map(Path::new);
    if let Some(folder) = folder {
        std::fs::create_dir_all(folder)?;
    }
    let file = match network.as_str() {
        "segmenter" => segmenter(&recipe, folder)?,
        "lights" => lights(&recipe, folder)?,
        "look" => look(&recipe, folder)?,
        other => return Err(format!("there is no network {other:?}\n{USAGE}").into()),
    };
    file.write(path("--out")?)?;
    eprintln!("{} parameters, weights digest {}", file.weights.parameters(), file.weights.digest());
    Ok(())
}

fn segmenter(recipe: &Recipe, folder: Option<&Path>) -> Result<WeightsFile, Box<dyn Error>> {
    let trained = training::segmenter::train(recipe, folder, &mut Lines)?;
    for target in Target::ALL {
        let (sharp, soft) = (trained.sharp.iou(target), trained.soft.iou(target));
        eprintln!("{} iou {sharp:.3?} softened {soft:.3?}", target.name());
    }
    Ok(trained.file)
}

fn lights(recipe: &Recipe, folder: Option<&Path>) -> Result<WeightsFile, Box<dyn Error>> {
    let trained = training::lights::train(recipe, folder, &mut Lines)?;
    let mut from = 0.0;
    for to in DISTANCES_M {
        let near: Vec<_> = trained.readings.iter().filter(|reading| (from..to).contains(&reading.distance_m)).collect();
        let right = near.iter().filter(|reading| reading.read == reading.truth).count();
        eprintln!("{from} to {to} m: {right} of {} read", near.len());
        from = to;
    }
    Ok(trained.file)
}

fn look(recipe: &Recipe, folder: Option<&Path>) -> Result<WeightsFile, Box<dyn Error>> {
    let trained = training::look::train(recipe, folder, &mut Lines)?;
    for (axis, (sharp, soft)) in ["lighting", "weather", "surface"].iter().zip(trained.sharp.iter().zip(&trained.soft))
    {
        eprintln!("{axis} named {sharp:.3} softened {soft:.3}");
    }
    Ok(trained.file)
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
