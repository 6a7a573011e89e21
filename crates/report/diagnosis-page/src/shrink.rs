//! How far the gap shrinks: each metric before and after on one axis in units of its noise floor, with the share
//! explained; and what the fit had promised against what came.

use ds_diagnosis::schema::{Diagnosis, Shrink};

use super::headline::{at_floor, gap, predicted, telling};
use super::markup::Markup;
use super::plot;
use super::words;

const LABELS: f64 = 190.0;
const VALUES: f64 = 560.0;
/// Left ends of the columns on the right: before, after, floor, unit, the bar of the share, its text.
const COLUMNS: [f64; 6] = [628.0, 690.0, 752.0, 762.0, 846.0, 1098.0];
const BAR: f64 = 112.0;
const ROW: f64 = 27.0;
const TOP: f64 = 50.0;
const APART: f64 = 12.0;

/// Writes the promise, then one row per metric.
pub(crate) fn section(m: &mut Markup, diagnosis: &Diagnosis) {
    let Some(first) = diagnosis.how_far.first() else { return };
    m.leaf(
        "p",
        &[("class", &"lead")],
        format_args!(
            "Measured {}. Left: error of the nominal simulator (ring), with the ordinary mismatch of every vehicle fitted \
             (bar) and with the effects added as well (dot), over the noise floor. Right: share of the gap from bar to \
             floor that the effects close, with its 90 % interval.",
            super::headline::data(first)
        ),
    );
    if diagnosis.chosen.is_empty() {
        m.leaf(
            "p",
            &[("class", &"lead")],
            "No effect was added: what shrinks from ring to bar is calibration, and the share of effects is 0.",
        );
    }
    if let Some(saved) = telling(diagnosis).and_then(saved) {
        m.leaf("p", &[("class", &"lead")], saved);
    }
    promise(m, diagnosis);
    let rows: Vec<&Shrink> = diagnosis.how_far.iter().collect();
    // the errors of whole rollouts first, then channel by channel
    let apart = |row: usize| if rows[row].metric.starts_with("channel:") { APART } else { 0.0 };
    let height = TOP + ROW * rows.len() as f64 + apart(rows.len() - 1) + 8.0;
    let ratios = rows.iter().filter(|s| s.floor > 0.0).flat_map(|s| [s.before / s.floor, s.after / s.floor]);
    let most = ratios.filter(|r| r.is_finite()).fold(2.0, f64::max);
    let scale = Scale { least: 0.5, most: most * 1.15 };
    plot::wide(m, "Metrics before and after", height, |m| {
        axis(m, &scale, height);
        for (row, shrink) in rows.iter().enumerate() {
            metric(m, shrink, TOP + apart(row) + ROW * (row as f64 + 0.5), &scale);
        }
    });
}

/// Says what was saved of a metric by what was added, in its unit; nothing where nothing was added.
pub(crate) fn saved(shrink: &Shrink) -> Option<String> {
    let saved = shrink.saved.as_ref()?;
    let (metric, unit) = words::metric(&shrink.metric);
    let words::Estimate { value, interval } =
        words::estimate(saved.value, saved.interval90.unwrap_or([f64::NAN; 2]), unit)?;
    let over = saved.note.as_ref().map_or_else(
        || format!(" {interval}, a 90\u{a0}% interval over {} drives", saved.drives),
        |note| format!("; {note}"),
    );
    Some(format!("What was added saves {value} in {metric}{over}."))
}

/// A logarithmic axis of errors in floor units.
struct Scale {
    least: f64,
    most: f64,
}

impl Scale {
    fn x(&self, ratio: f64) -> f64 {
        let share = (ratio.max(self.least) / self.least).ln() / (self.most / self.least).ln();
        LABELS + (VALUES - LABELS) * share.clamp(0.0, 1.0)
    }
}

fn axis(m: &mut Markup, scale: &Scale, height: f64) {
    let mut last = f64::NEG_INFINITY;
    for tick in [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 1e4, 1e5] {
        let x = scale.x(tick);
        if tick > scale.most || x - last < 26.0 {
            continue;
        }
        last = x;
        plot::line(m, if tick > 1.0 { "grid" } else { "grid floor" }, (x, TOP - 6.0), (x, height - 6.0));
        plot::text(m, "tick", (x, TOP - 14.0), &if tick > 1.0 { format!("{tick} ×") } else { "floor".to_owned() });
    }
    for (x, words) in [(COLUMNS[0], "before"), (COLUMNS[1], "after"), (COLUMNS[2], "floor")] {
        plot::text(m, "tick end", (x, TOP - 14.0), words);
    }
    for share in [0.0, 0.5, 1.0] {
        let x = COLUMNS[4] + BAR * share;
        plot::line(m, "grid", (x, TOP - 6.0), (x, height - 6.0));
        plot::text(m, "tick", (x, TOP - 14.0), &words::share(share));
    }
    plot::text(m, "head", (COLUMNS[4] + BAR / 2.0, 14.0), "share explained");
    plot::text(m, "head", ((LABELS + VALUES) / 2.0, 14.0), "error over noise floor");
}

fn metric(m: &mut Markup, shrink: &Shrink, y: f64, scale: &Scale) {
    let (title, unit) = words::metric(&shrink.metric);
    let none = at_floor(shrink) || !shrink.before.is_finite();
    let calibrated = shrink.nuisance.filter(|_| shrink.floor > 0.0).map(|v| v / shrink.floor).filter(|r| r.is_finite());
    let [before, after, floor] = words::aligned([shrink.before, shrink.after, shrink.floor]);
    let told = format!("{title}: {before} before, {after} after, floor {floor} {unit}");
    m.inside("g", &[("class", &if none { "metric quiet" } else { "metric" })], |m| {
        m.leaf("title", &[], told);
        plot::text(m, "label", (LABELS - 16.0, y + 4.5), &plot::short(&words::capital(&title), 26));
        if shrink.floor > 0.0 && shrink.before.is_finite() && shrink.after.is_finite() {
            let [x0, x1] = [shrink.before, shrink.after].map(|v| scale.x(v / shrink.floor));
            let class = if x1 > x0 { "way worse" } else { "way" };
            plot::line(m, class, (x0, y), (x1, y));
            plot::dot(m, "ring", (x0, y), 5.0);
            if let Some(x) = calibrated.map(|ratio| scale.x(ratio)) {
                plot::line(m, "whisker", (x, y - 6.0), (x, y + 6.0));
            }
            plot::dot(m, "dot", (x1, y), 5.0);
        }
        for (x, words) in [(COLUMNS[0], &before), (COLUMNS[1], &after), (COLUMNS[2], &floor)] {
            plot::text(m, if x < COLUMNS[2] { "figure" } else { "value" }, (x, y + 4.5), words);
        }
        plot::text(m, "unit", (COLUMNS[3], y + 4.5), unit);
        match shrink.share_explained.filter(|_| !none) {
            Some(explained) => share(m, explained, shrink.interval90, y),
            None => plot::text(m, "unit", (COLUMNS[4], y + 4.5), "no gap beyond the floor"),
        }
    });
}

fn share(m: &mut Markup, explained: f64, interval90: Option<[f64; 2]>, y: f64) {
    let x = |share: f64| COLUMNS[4] + BAR * share.clamp(0.0, 1.0);
    let worse = explained < 0.0;
    plot::area(m, "share", (COLUMNS[4], y - 6.0), (x(explained) - COLUMNS[4], 12.0), "");
    if let Some([low, high]) = interval90.filter(|[low, high]| low.is_finite() && high.is_finite() && *high > 0.0) {
        plot::line(m, "whisker", (x(low), y), (x(high), y));
        for end in [low, high].into_iter().filter(|end| *end > 0.0) {
            plot::line(m, "whisker", (x(end), y - 4.0), (x(end), y + 4.0));
        }
    }
    let class = if worse { "value strong bad" } else { "value strong" };
    plot::text(m, class, (COLUMNS[5] - 80.0, y + 4.5), &words::share(explained));
    plot::text(m, "value", (COLUMNS[5], y + 4.5), &interval90.map(words::shares).unwrap_or_default());
}

/// Writes what the fit promised for its metric beside what came.
fn promise(m: &mut Markup, diagnosis: &Diagnosis) {
    let Some(shrink) = predicted(diagnosis) else { return };
    let (Some(explained), Some(promised)) = (shrink.share_explained, diagnosis.predicted_share) else { return };
    m.inside("div", &[("class", &"promise")], |m| {
        plot::picture(m, "inline plot", "Promised and realised share", (346.0, 54.0), |m| {
            let x = |share: f64| 14.0 + 300.0 * share.clamp(0.0, 1.0);
            for tick in [0.0, 0.25, 0.5, 0.75, 1.0] {
                plot::line(m, "grid", (x(tick), 6.0), (x(tick), 36.0));
                plot::text(m, "tick", (x(tick), 50.0), &words::share(tick));
            }
            plot::line(m, "grid", (x(0.0), 26.0), (x(1.0), 26.0));
            if let Some(ends) =
                shrink.interval90.map(|ends| ends.map(x)).filter(|ends| ends.iter().all(|x| x.is_finite()))
            {
                plot::line(m, "whisker realised", (ends[0], 26.0), (ends[1], 26.0));
            }
            plot::dot(m, "dot", (x(explained), 26.0), 5.0);
            let at = x(promised);
            let corners = [(at, 8.0), (at + 5.5, 13.5), (at, 19.0), (at - 5.5, 13.5)];
            m.void("polygon", &[("class", &"promised"), ("points", &plot::joined(&corners))]);
        });
        m.inside("p", &[], |m| {
            m.text(format_args!("Of {} the fit promised ", gap(shrink)));
            m.leaf("b", &[], format_args!("{} (diamond)", words::share(promised)));
            m.text("; realised: ");
            m.leaf("b", &[], words::share(explained));
            m.text(format_args!(" {} (dot).", shrink.interval90.map(words::shares).unwrap_or_default()));
        });
    });
}
