//! The page of a training: the loss of every stage as a curve and its contact sheet, `index.html` in the work folder, and
//! all curves as one picture, `curves.svg`.

use std::path::{Path, PathBuf};

use ds_page::{Document, Markup, Pictures, svg};
use serde_json::Value;

use crate::config::TrainConfig;
use crate::error::TrainError;

/// Stages with a loss log, in order.
const STAGES: [&str; 6] = ["autoencoder", "prior", "teacher", "ode", "self_forcing", "decoder"];
const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 180.0;
/// Points of a curve; longer logs are averaged over spans.
const POINTS: usize = 320;

const STYLE: &str = ":root{--width:70rem;--curve:#27639b}main{padding:2rem 1rem}h2{margin-top:2rem}\
@media(prefers-color-scheme:dark){:root{--curve:#6cbfe6}}\
svg{background:var(--surface);border:1px solid var(--line);width:100%;height:auto}\
img{max-width:100%;image-rendering:pixelated}text{font-size:11px;fill:var(--muted)}\
polyline{fill:none;stroke:var(--curve);stroke-width:1.5}";

const SHEET_STYLE: &str =
    "text{font:11px system-ui,sans-serif;fill:#555}polyline{fill:none;stroke:#27639b;stroke-width:1.5}";

/// The loss of a network over steps, long logs averaged over spans.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// The network.
    pub name: String,
    /// Steps and losses.
    pub points: Vec<(f64, f64)>,
}

/// Returns the stages that left a log: name, curves, and the contact sheet's path if there is one.
#[must_use]
pub fn stages(config: &TrainConfig) -> Vec<(&'static str, Vec<Curve>, Option<PathBuf>)> {
    let stage = |name: &'static str| {
        let curves = curves(&config.folder.join(format!("{name}.jsonl")));
        let sheet = Some(config.folder.join(format!("{name}.png"))).filter(|path| path.exists());
        (name, curves, sheet)
    };
    STAGES.map(stage).into_iter().filter(|(_, curves, _)| !curves.is_empty()).collect()
}

/// Writes the page and returns where it is.
///
/// # Errors
/// If the folder cannot be written.
pub fn write(config: &TrainConfig) -> Result<PathBuf, TrainError> {
    let path = config.folder.join("index.html");
    let io = || TrainError::io("training page", &path);
    std::fs::create_dir_all(&config.folder).map_err(io())?;
    let found = stages(config);
    let document = Document { title: "Training", style: STYLE, script: None, pictures: Pictures::Beside };
    let page = document.page(|m| {
        m.inside("main", &[], |m| {
            m.leaf("h1", &[], format!("Training in {}", config.folder.display()));
            for (stage, curves, sheet) in &found {
                section(m, stage, curves, sheet.is_some());
            }
        });
    });
    std::fs::write(&path, page).map_err(io())?;
    let picture = config.folder.join("curves.svg");
    std::fs::write(&picture, curve_sheet(&found)).map_err(TrainError::io("training curves", &picture))?;
    Ok(path)
}

/// Draws the curves of all stages below each other in two columns.
fn curve_sheet(stages: &[(&'static str, Vec<Curve>, Option<PathBuf>)]) -> String {
    let curves: Vec<(&str, &Curve)> =
        stages.iter().flat_map(|(stage, curves, _)| curves.iter().map(|curve| (*stage, curve))).collect();
    let (tile, columns) = (HEIGHT + 30.0, 2);
    let rows = curves.len().div_ceil(columns);
    #[expect(clippy::cast_precision_loss, reason = "a few tiles")]
    let view = format!("0 0 {} {}", WIDTH * columns as f64, tile * rows as f64);
    let mut m = Markup::default();
    m.inside("svg", &[("xmlns", &"http://www.w3.org/2000/svg"), ("viewBox", &view)], |m| {
        m.inside("style", &[], |m| m.raw(SHEET_STYLE));
        for (at, (stage, curve)) in curves.into_iter().enumerate() {
            #[expect(clippy::cast_precision_loss, reason = "a few tiles")]
            let place = format!("translate({} {})", WIDTH * (at % columns) as f64, tile * (at / columns) as f64);
            m.inside("g", &[("transform", &place)], |m| {
                m.leaf("text", &[("x", &50), ("y", &16)], format!("{}, {}", stage.replace('_', " "), curve.name));
                m.inside("g", &[("transform", &"translate(0 20)")], |m| line(m, curve));
            });
        }
    });
    m.finish()
}

fn section(m: &mut Markup, stage: &str, curves: &[Curve], sheet: bool) {
    m.leaf("h2", &[], stage.replace('_', " "));
    for curve in curves {
        let last = curve.points.last().map_or((0.0, 0.0), |point| *point);
        m.leaf("p", &[], format!("{}: {:.5} after {} steps", curve.name, last.1, last.0));
        plot(m, curve);
    }
    if sheet {
        let alt = "samples: true frames, generated frames, layouts";
        m.void("img", &[("src", &format!("{stage}.png")), ("alt", &alt)]);
    }
}

/// Reads the losses of a log: every object with a `loss` is a network; a step written twice counts once, the last time.
fn curves(path: &Path) -> Vec<Curve> {
    let Ok(text) = std::fs::read_to_string(path) else { return Vec::new() };
    let mut found: std::collections::BTreeMap<String, std::collections::BTreeMap<u64, f64>> = Default::default();
    for line in text.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok()) {
        let (Some(step), Some(fields)) = (line["step"].as_u64(), line.as_object()) else { continue };
        for (name, loss) in fields.iter().filter_map(|(name, value)| Some((name, value["loss"].as_f64()?))) {
            found.entry(name.clone()).or_default().insert(step, loss);
        }
    }
    let thin = |steps: std::collections::BTreeMap<u64, f64>| {
        let all: Vec<(u64, f64)> = steps.into_iter().collect();
        let mean = |span: &[(u64, f64)]| {
            #[expect(clippy::cast_precision_loss, reason = "a curve to look at")]
            let (last, count) = (span.last().map_or(0, |point| point.0) as f64, span.len() as f64);
            (last, span.iter().map(|point| point.1).sum::<f64>() / count)
        };
        all.chunks(all.len().div_ceil(POINTS).max(1)).map(mean).collect()
    };
    found.into_iter().map(|(name, steps)| Curve { name, points: thin(steps) }).collect()
}

/// Draws a curve as a picture of its own.
fn plot(m: &mut Markup, curve: &Curve) {
    svg::picture(m, "inline", "loss over steps", (WIDTH, HEIGHT), |m| line(m, curve));
}

/// Draws a curve with a logarithmic loss axis.
fn line(m: &mut Markup, curve: &Curve) {
    let height = |loss: f64| loss.max(1e-9).ln();
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for (_, loss) in &curve.points {
        (low, high) = (low.min(height(*loss)), high.max(height(*loss)));
    }
    let (first, last) = match (curve.points.first(), curve.points.last()) {
        (Some(first), Some(last)) => (first.0, last.0),
        _ => return,
    };
    let x = |step: f64| 50.0 + (WIDTH - 60.0) * (step - first) / (last - first).max(1.0);
    let y = |loss: f64| 10.0 + (HEIGHT - 30.0) * (high - height(loss)) / (high - low).max(1e-9);
    let points: Vec<(f64, f64)> = curve.points.iter().map(|(step, loss)| (x(*step), y(*loss))).collect();
    svg::path(m, "loss", &points);
    for bound in [low.exp(), high.exp()] {
        m.leaf("text", &[("x", &2), ("y", &(y(bound) + 4.0))], format!("{bound:.4}"));
    }
    m.leaf("text", &[("x", &(WIDTH - 60.0)), ("y", &(HEIGHT - 5.0))], format!("step {last}"));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_that_was_made_again_counts_once() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("ode.jsonl");
        let line = |step: u32, loss: f32| format!("{{\"step\":{step},\"model\":{{\"loss\":{loss},\"rate\":0.1}}}}\n");
        std::fs::write(&path, [line(1, 4.0), line(2, 3.0), line(2, 2.0), "cut off".to_owned()].concat())
            .expect("writes");
        let found = curves(&path);
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].points, [(1.0, 4.0), (2.0, 2.0)]);
        let sheet = curve_sheet(&[("ode", found.clone(), None), ("teacher", found, None)]);
        assert_eq!((sheet.matches("<polyline").count(), sheet.matches("translate(640 0)").count()), (2, 1), "{sheet}");
    }
}
