//! The page of study `closed-loop`: how far drives lie from those on the reference, by policy and source.

use std::path::Path;

use ds_page::svg::{dot, line, text, wide};
use ds_page::{Document, Markup, Pictures};

use super::{STYLE, shown};
use crate::error::EvaluationError;
use crate::page::table::table;
use crate::study::closed_loop::{ClosedLoop, Gap, Nearer, REFERENCE};

/// Writes `closed-loop.json` and `index.html` into a folder.
///
/// # Errors
/// If a file cannot be written.
pub fn write_drives(out: &Path, found: &ClosedLoop) -> Result<(), EvaluationError> {
    let path = out.join("closed-loop.json");
    let text = serde_json::to_string_pretty(found)
        .map_err(|source| EvaluationError::Record { path: path.display().to_string(), source })?;
    std::fs::write(&path, text + "\n").map_err(EvaluationError::io("outcome", &path))?;
    let path = out.join("index.html");
    std::fs::write(&path, html(found)).map_err(EvaluationError::io("page", &path))
}

/// Returns the page.
fn html(found: &ClosedLoop) -> String {
    let document = Document { title: "Drives on other frames", style: STYLE, script: None, pictures: Pictures::Beside };
    document.page(|m| m.inside("main", &[], |m| body(m, found)))
}

fn body(m: &mut Markup, found: &ClosedLoop) {
    m.leaf("h1", &[], "Drives on other frames");
    m.leaf(
        "p",
        &[("class", &"lead")],
        format_args!(
            "How far the driving score of the same drive lies from that on the reference camera's frames, in points of 0 to \
             100; sets: {}. Differences below 1.3 points are no findings.",
            found.sets.join(", ")
        ),
    );
    if found.quick {
        m.leaf("p", &[("class", &"warn")], "A quick look: too few scenarios for a judgement.");
    }
    plot(m, found);
    let rows =
        found.gaps.iter().flat_map(|(policy, gaps)| gaps.iter().map(move |(source, gap)| row(policy, source, gap)));
    let head =
        ["policy", "frames", "drives", "mean |DS − DS on reference|", "mean difference", "DS", "rank correlation"];
    table(m, &head, &rows.collect::<Vec<_>>());
    m.leaf("h2", &[], "On the reference");
    let rows = found.reference.iter().map(|(policy, figure)| vec![policy.clone(), shown(*figure)]);
    table(m, &["policy", "DS"], &rows.collect::<Vec<_>>());
    m.leaf("h2", &[], "Which frames are nearer");
    m.leaf(
        "p",
        &[],
        "Distance of the first less that of the second, paired by scenario; sign flips, Holm over all rows.",
    );
    let row = |nearer: &Nearer| {
        vec![
            nearer.policy.clone(),
            format!("{} against {}", nearer.source, nearer.than),
            shown(nearer.apart),
            format!("{:.4}", nearer.p),
            format!("{:.4}", nearer.p_holm),
            verdict(nearer).to_owned(),
        ]
    };
    let head = ["policy", "frames", "points", "p", "p (Holm)", ""];
    table(m, &head, &found.nearer.iter().map(row).collect::<Vec<_>>());
    m.leaf("h2", &[], "Order of policies");
    m.leaf("p", &[], "Policies whose means lie less than 1.3 points apart may change places without a meaning.");
    let row = |(source, order): (&String, &Vec<String>)| {
        let same = if found.order.get(REFERENCE) == Some(order) { "as on the reference" } else { "another order" };
        vec![source.clone(), order.join(" > "), same.to_owned()]
    };
    table(m, &["frames", "by mean DS", ""], &found.order.iter().map(row).collect::<Vec<_>>());
}

fn verdict(nearer: &Nearer) -> &'static str {
    match (nearer.p_holm < 0.05, nearer.apart.value < 0.0) {
        (false, _) => "level",
        (true, true) => "nearer",
        (true, false) => "further",
    }
}

fn row(policy: &str, source: &str, gap: &Gap) -> Vec<String> {
    vec![
        policy.to_owned(),
        source.to_owned(),
        gap.drives.to_string(),
        shown(gap.distance),
        shown(gap.difference),
        shown(gap.driving_score),
        gap.spearman.map_or_else(|| "–".to_owned(), |r| format!("{r:.2}")),
    ]
}

fn plot(m: &mut Markup, found: &ClosedLoop) {
    let rows: Vec<(String, &Gap)> = found
        .gaps
        .iter()
        .flat_map(|(policy, gaps)| gaps.iter().map(move |(source, gap)| (format!("{policy} on {source}"), gap)))
        .collect();
    let most = rows.iter().map(|(_, gap)| gap.distance.high).fold(1.0, f64::max);
    let x = |value: f64| 250.0 + 360.0 * value.max(0.0) / most;
    let height = 40.0 + 24.0 * rows.len() as f64;
    wide(m, "Distance from drives on the reference", (640.0, height), |m| {
        line(m, "axis", (x(0.0), 8.0), (x(0.0), height - 24.0));
        line(m, "axis", (x(most), 8.0), (x(most), height - 24.0));
        text(m, "", (x(0.0) - 4.0, height - 8.0), "0");
        text(m, "", (x(most) - 60.0, height - 8.0), &format!("{most:.1} points"));
        for (row, (name, gap)) in rows.iter().enumerate() {
            let y = 22.0 + 24.0 * row as f64;
            text(m, "", (8.0, y + 4.0), name);
            line(m, "l0", (x(gap.distance.low), y), (x(gap.distance.high), y));
            dot(m, "b0", (x(gap.distance.value), y), 4.0);
        }
    });
}
