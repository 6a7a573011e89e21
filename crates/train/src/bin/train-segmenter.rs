//! Trains the segmenter: `train-segmenter SETTINGS OUT`, with a line now and then and its overlaps at the end.

use std::error::Error;
use std::path::Path;
use std::process::ExitCode;

use ds_train::Progress;
use ds_train::segmenter::overlap::Target;
use ds_train::segmenter::{SegmenterSettings, train};

struct Lines;

impl Progress for Lines {
    fn step(&mut self, step: u32, total: u32, loss: f32, _figures: &[(&str, f32)]) {
        if step.is_multiple_of(20) {
            eprintln!("step {step}/{total} loss {loss:.4}");
        }
    }

    fn note(&mut self, text: &str) {
        eprintln!("{text}");
    }
}

fn work(arguments: &[String]) -> Result<(), Box<dyn Error>> {
    let [settings, out] = arguments else { return Err("usage: train-segmenter SETTINGS OUT".into()) };
    let settings = SegmenterSettings::parse(&std::fs::read_to_string(settings)?)?;
    let trained = train(&settings, &mut Lines)?;
    trained.file.write(Path::new(out))?;
    eprintln!("weights digest {}", trained.file.weights.digest());
    for target in Target::ALL {
        let (sharp, soft) = (trained.sharp.iou(target), trained.soft.iou(target));
        eprintln!("{} iou {sharp:.3?} softened {soft:.3?}", target.name());
    }
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
