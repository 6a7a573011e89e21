//! The report of a measurement: JSON, a table in Markdown and a contact sheet.
//!
//! Figures are pooled over the pixels of all drives. Intervals are 95 % bootstrap intervals over drives: drives are
//! drawn with replacement, keyed by a fixed seed, and the figure is computed anew.

use std::path::Path;

use ds_space::Draws;
use serde_json::{Value, json};

use super::{Difference, DriveMeasured, Measured};
use crate::error::TrainError;
use crate::segmenter::overlap::{Overlaps, Target};
use crate::sheet;

const RESAMPLES: u64 = 2_000;

/// A figure with its interval; infinite where the divisor is zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Over all drives.
    pub value: f64,
    /// Where 2.5 % of the resamples lie below.
    pub low: f64,
    /// Where 2.5 % of the resamples lie above.
    pub high: f64,
}

/// Computes a figure of all drives and its bootstrap interval; none where the figure is unknown.
#[must_use]
pub fn bootstrap(
    drives: &[DriveMeasured],
    figure: impl Fn(&mut dyn Iterator<Item = &DriveMeasured>) -> Option<f64>,
) -> Option<Estimate> {
    let value = figure(&mut drives.iter())?;
    let draws = |resample: u64| Draws::from_seed(resample, "bootstrap over drives");
    let mut values: Vec<f64> = (0..RESAMPLES)
        .filter_map(|resample| {
            let draws = draws(resample);
            let count = drives.len() as u64;
            figure(&mut (0..count).map(|index| &drives[draws.below(index, count) as usize]))
        })
        .collect();
    values.sort_by(f64::total_cmp);
    let at = |share: f64| {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of the number of values")]
        let index = (share * (values.len() - 1) as f64).round() as usize;
        values[index]
    };
    (!values.is_empty()).then(|| Estimate { value, low: at(0.025), high: at(0.975) })
}

fn pooled(
    drives: &mut dyn Iterator<Item = &DriveMeasured>,
    part: impl Fn(&DriveMeasured) -> [Overlaps; 3],
) -> [Overlaps; 3] {
    let mut sums = [Overlaps::default(); 3];
    for drive in drives {
        sums.iter_mut().zip(part(drive)).for_each(|(sum, more)| sum.merge(&more));
    }
    sums
}

fn arms(drive: &DriveMeasured) -> [Overlaps; 3] {
    [drive.reference, drive.with_layout, drive.without_layout]
}

/// Returns how many times higher the IoU of a target is with the layout than without.
#[must_use]
pub fn ratio(drives: &[DriveMeasured], target: Target) -> Option<Estimate> {
    bootstrap(drives, |drives| {
        let [_, with, without] = pooled(drives, arms);
        Some(with.iou(target)? / without.iou(target)?).filter(|ratio| !ratio.is_nan())
    })
}

/// Returns how many times more frames change by taking the agents out of the layout where they were than elsewhere.
#[must_use]
pub fn contrast(drives: &[DriveMeasured]) -> Option<Estimate> {
    bootstrap(drives, |drives| {
        let (inside, outside) = changes(drives);
        Some(inside.mean()? / outside.mean()?).filter(|ratio| !ratio.is_nan())
    })
}

fn changes(drives: &mut dyn Iterator<Item = &DriveMeasured>) -> (Difference, Difference) {
    let (mut inside, mut outside) = (Difference::default(), Difference::default());
    for drive in drives {
        inside.merge(&drive.inside);
        outside.merge(&drive.outside);
    }
    (inside, outside)
}

/// Returns the whole measurement as JSON.
#[must_use]
pub fn as_json(measured: &Measured) -> Value {
    let estimate = |estimate: Option<Estimate>| {
        estimate.map_or(Value::Null, |e| json!({"value": e.value, "low": e.low, "high": e.high}))
    };
    let iou = |overlaps: &Overlaps| -> Value {
        Target::ALL.iter().map(|target| (target.name().to_owned(), json!(overlaps.iou(*target)))).collect()
    };
    let three = |[reference, with, without]: [Overlaps; 3]| {
        let (reference, with, without) = (iou(&reference), iou(&with), iou(&without));
        json!({"reference": reference, "with_layout": with, "without_layout": without})
    };
    let drives: Vec<Value> = measured
        .drives
        .iter()
        .map(|drive| {
            let change = json!({"inside": drive.inside.mean(), "outside": drive.outside.mean()});
            let iou = three(arms(drive));
            json!({"family": drive.family, "seed": drive.seed, "iou": iou, "change_without_agents": change})
        })
        .collect();
    let ratios: Value = Target::ALL
        .iter()
        .map(|target| (target.name().to_owned(), estimate(ratio(&measured.drives, *target))))
        .collect();
    let (inside, outside) = changes(&mut measured.drives.iter());
    let contrast = estimate(contrast(&measured.drives));
    json!({
        "version": 1,
        "weights_digest": measured.weights_digest.to_string(),
        "decoder_guided": measured.decoder_guided,
        "ticks": [measured.span.first_tick, measured.span.last_tick],
        "iou": three(pooled(&mut measured.drives.iter(), arms)),
        "ratio_with_over_without_layout": ratios,
        "change_without_agents": {"inside": inside.mean(), "outside": outside.mean(), "ratio": contrast},
        "drives": drives,
    })
}

/// Returns the table of the measurement in Markdown.
#[must_use]
pub fn as_markdown(measured: &Measured) -> String {
    let number = |value: Option<f64>| value.map_or("–".to_owned(), |value| format!("{value:.3}"));
    let interval = |estimate: Option<Estimate>| {
        estimate.map_or("–".to_owned(), |e| format!("{:.2} ({:.2} to {:.2})", e.value, e.low, e.high))
    };
    let [reference, with, without] = pooled(&mut measured.drives.iter(), arms);
    let (drives, digest) = (measured.drives.len(), measured.weights_digest);
    let (first, last) = (measured.span.first_tick, measured.span.last_tick);
    let guided = if measured.decoder_guided { "guided" } else { "plain" };
    let mut text = format!("{drives} drives, ticks {first} to {last}, {guided} decoder, weights `{digest}`.\n\n");
    text.push_str("| IoU | reference frames | with layout | layout off | ratio (95 %) |\n|---|---|---|---|---|\n");
    for target in Target::ALL {
        let [reference, with, without] = [reference, with, without].map(|overlaps| number(overlaps.iou(target)));
        let ratio = interval(ratio(&measured.drives, target));
        text.push_str(&format!("| {} | {reference} | {with} | {without} | {ratio} |\n", target.name()));
    }
    let (inside, outside) = changes(&mut measured.drives.iter());
    let contrast = interval(contrast(&measured.drives));
    text.push_str("\n| change by taking the agents out | where they were | elsewhere | ratio (95 %) |\n");
    text.push_str("|---|---|---|---|\n");
    text.push_str(&format!("| mean of 255 | {} | {} | {contrast} |\n", number(inside.mean()), number(outside.mean())));
    text
}

/// Writes `layout-following.json`, `.md` and `.png` into a folder.
///
/// # Errors
/// If a file cannot be written.
pub fn write(measured: &Measured, folder: &Path) -> Result<(), TrainError> {
    std::fs::create_dir_all(folder).map_err(TrainError::io("report folder", folder))?;
    let texts = [("json", format!("{:#}\n", as_json(measured))), ("md", as_markdown(measured))];
    for (kind, text) in texts {
        let path = folder.join("layout-following").with_extension(kind);
        std::fs::write(&path, text).map_err(TrainError::io("report", &path))?;
    }
    sheet::write(&folder.join("layout-following.png"), &measured.sheet)
}
