//! The files of an evaluation: `eval.json` for programs, `outcome.json` with everything, `index.html` for people.

use std::path::Path;

use serde_json::{Map, Value, json};

use crate::config::{DIVERSE_ARMS, DRIFT_ARMS, EvalConfig, GUIDANCE_ARMS, LAYOUT_ARMS, LAYOUT_TARGETS, SHARPNESS_ARMS};
use crate::error::EvaluationError;
use crate::estimate::{CONFIDENCE, Estimate};
use crate::outcome::{LookFigures, Outcome, Sharpness, WordedOutcome};
use crate::page;

/// The column that `eval.json` shows at its top.
pub const FIRST_COLUMN: &str = "A";

/// Reads the outcome of an earlier run; an empty one if there is none.
///
/// # Errors
/// If the file is there and broken.
pub fn earlier(folder: &Path) -> Result<Outcome, EvaluationError> {
    let path = folder.join("outcome.json");
    match std::fs::read_to_string(&path) {
        Ok(text) => serde_json::from_str(&text)
            .map_err(|source| EvaluationError::Record { path: path.display().to_string(), source }),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Outcome::default()),
        Err(error) => Err(EvaluationError::io("outcome", &path)(error)),
    }
}

/// Writes `eval.json`, `outcome.json` and `index.html`.
///
/// # Errors
/// If a file cannot be written.
pub fn write(outcome: &Outcome, config: &EvalConfig) -> Result<(), EvaluationError> {
    let folder = &config.out;
    std::fs::create_dir_all(folder).map_err(EvaluationError::io("folder of results", folder))?;
    let broken = |source| EvaluationError::Record { path: "outcome.json".to_owned(), source };
    let files = [
        ("eval.json", format!("{:#}\n", eval_json(outcome, config))),
        ("outcome.json", serde_json::to_string_pretty(outcome).map_err(broken)?),
        ("index.html", page::html(outcome, config)),
    ];
    for (name, text) in files {
        let path = folder.join(name);
        let partial = path.with_extension("partial");
        std::fs::write(&partial, text).map_err(EvaluationError::io("result", &partial))?;
        std::fs::rename(&partial, &path).map_err(EvaluationError::io("result", &path))?;
    }
    Ok(())
}

fn value(estimate: Option<Estimate>) -> Value {
    estimate.map_or(Value::Null, |e| json!({"value": e.value, "low": e.low, "high": e.high, "samples": e.samples}))
}

/// Returns the figures by the names that other programs know; `null` where something was not measured. The top level
/// holds column A, `columns` the same tables for every column.
#[must_use]
pub fn eval_json(outcome: &Outcome, config: &EvalConfig) -> Value {
    let columns = outcome.columns();
    let mut all = Map::new();
    for column in &columns {
        all.insert(column.clone(), column_json(outcome, config, column));
    }
    let mut top = column_json(outcome, config, FIRST_COLUMN);
    let speed = outcome.speed.as_ref();
    let arms: Map<String, Value> = outcome
        .arms
        .iter()
        .map(|(name, arm)| (name.clone(), json!({"kind": arm.kind, "digest": arm.digest, "remark": arm.remark})))
        .collect();
    if let Value::Object(top) = &mut top {
        top.insert("version".to_owned(), json!(1));
        top.insert("quick".to_owned(), json!(outcome.quick));
        top.insert("confidence".to_owned(), json!(CONFIDENCE));
        top.insert("frames_per_second".to_owned(), value(speed.and_then(|speed| speed.frames_per_second)));
        top.insert("gemm_share".to_owned(), value(speed.and_then(|speed| speed.gemm_share)));
        top.insert("transformer_gflops".to_owned(), value(speed.and_then(|speed| speed.transformer_gflops)));
        top.insert("gemm_gflops".to_owned(), value(speed.and_then(|speed| speed.gemm_gflops)));
        top.insert("first_frames".to_owned(), first_frames_json(outcome));
        top.insert("arms".to_owned(), Value::Object(arms));
        top.insert("perception".to_owned(), json!(outcome.perception));
        top.insert("columns".to_owned(), Value::Object(all));
    }
    top
}

fn column_json(outcome: &Outcome, config: &EvalConfig, column: &str) -> Value {
    let layout = outcome.layout.as_ref();
    let figures = layout.and_then(|layout| layout.columns.get(column));
    let mut layout_iou = Map::new();
    for target in LAYOUT_TARGETS {
        let of = |key: &str| {
            let arm = layout.and_then(|layout| layout.iou.get(key));
            let figures = arm.and_then(|arm| figures?.arms.get(arm));
            value(figures.and_then(|figures| figures.iou.get(target).copied().flatten()))
        };
        let mut row: Map<String, Value> = LAYOUT_ARMS.iter().map(|key| ((*key).to_owned(), of(key))).collect();
        let reference = figures.and_then(|figures| figures.reference.iou.get(target).copied().flatten());
        row.insert("reference".to_owned(), value(reference));
        layout_iou.insert(target.to_owned(), Value::Object(row));
    }
    let distance = |key: &&str| {
        let arm = layout.and_then(|layout| layout.feature_distance.get(*key));
        let figures = arm.and_then(|arm| figures?.arms.get(arm));
        ((*key).to_owned(), value(figures.and_then(|figures| figures.frechet)))
    };
    let feature_distance: Map<String, Value> = GUIDANCE_ARMS.iter().map(distance).collect();
    let comparisons: Map<String, Value> = figures
        .iter()
        .flat_map(|figures| &figures.comparisons)
        .map(|(name, estimate)| (name.clone(), value(*estimate)))
        .collect();
    json!({
        "sharpness": sharpness_json(outcome, column),
        "layout_iou": layout_iou,
        "feature_distance": feature_distance,
        "drift": drift_json(outcome, column),
        "appearance_at_100": appearance_json(outcome, config, column),
        "comparisons": comparisons,
    })
}

fn sharpness_json(outcome: &Outcome, column: &str) -> Value {
    let part = outcome.sharpness.as_ref();
    let arm = |key: &&str| {
        let found = part.and_then(|part| part.columns.get(column)?.get(part.arms.get(*key)?));
        let figure = |of: fn(&Sharpness) -> Option<Estimate>| value(found.and_then(of));
        let figures = json!({
            "psnr_db": figure(|found| found.psnr_db),
            "laplacian_ratio": figure(|found| found.laplacian_ratio),
            "border_ratio": figure(|found| found.border_ratio),
            "reference_border_ratio": figure(|found| found.reference_border_ratio),
            "seam": figure(|found| found.seam),
            "off_road_distance": figure(|found| found.off_road_distance),
        });
        ((*key).to_owned(), figures)
    };
    let mut figures: Map<String, Value> = SHARPNESS_ARMS.iter().map(arm).collect();
    let gain = part.and_then(|part| part.structures_gain.get(column).copied());
    figures.insert("structures_gain".to_owned(), value(gain));
    figures.into()
}

fn first_frames_json(outcome: &Outcome) -> Value {
    let Some(part) = &outcome.first_frames else { return Value::Null };
    let shown = |shown: &LookFigures| {
        json!({
            "recognised": value(shown.recognised),
            "luma": value(shown.luma),
            "ground": value(shown.ground),
            "contrast": value(shown.contrast),
            "detail": value(shown.detail),
        })
    };
    let row = |(name, found): (&String, &WordedOutcome)| {
        (name.clone(), json!({"words": shown(&found.words), "reference": shown(&found.own)}))
    };
    let conditions: Map<String, Value> = part.conditions.iter().map(row).collect();
    json!({"recognised": value(part.recognised), "conditions": conditions})
}

fn drift_json(outcome: &Outcome, column: &str) -> Value {
    let drift = outcome.drift.as_ref();
    let found = drift.and_then(|drift| drift.columns.get(column));
    let arm = |key: &&str| {
        let figures = drift.and_then(|drift| drift.arms.get(*key)).and_then(|arm| found?.arms.get(arm));
        let at = |mark: u32| {
            let points = figures.map(|figures| figures.curve.iter());
            value(points.and_then(|mut points| points.find(|(at, _)| *at == mark)?.1))
        };
        let rise = value(figures.and_then(|figures| figures.rise));
        ((*key).to_owned(), json!({"at_50": at(50), "at_200": at(200), "rise": rise}))
    };
    let mut rows: Map<String, Value> = DRIFT_ARMS.iter().map(arm).collect();
    rows.insert("difference".to_owned(), value(found.and_then(|found| found.difference)));
    rows.insert("reduction".to_owned(), value(found.and_then(|found| found.reduction)));
    Value::Object(rows)
}

fn appearance_json(outcome: &Outcome, config: &EvalConfig, column: &str) -> Value {
    let Some(part) = &config.appearance else { return json!({}) };
    let measured = outcome.appearance.as_ref();
    let row = |condition: &String| {
        let found = measured.and_then(|measured| measured.columns.get(column)?.get(condition));
        let arm = |key: &str| {
            let arm = measured.and_then(|measured| measured.arms.get(key));
            value(arm.and_then(|arm| found?.arms.get(arm).copied().flatten()))
        };
        let mut row: Map<String, Value> = DIVERSE_ARMS.iter().map(|key| ((*key).to_owned(), arm(key))).collect();
        row.insert("reference".to_owned(), value(found.and_then(|found| found.reference)));
        row.insert("gain".to_owned(), value(found.and_then(|found| found.gain)));
        row.insert("named".to_owned(), json!(found.map(|found| &found.named)));
        (condition.clone(), Value::Object(row))
    };
    Value::Object(part.conditions.iter().map(row).collect())
}
