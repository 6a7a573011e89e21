//! Residuals over time on a drive: the position error after 2 s and the channels with the largest gap, nominal and
//! corrected, over the noise floor; spans in which the gap is significant are shaded.

use ds_diagnosis::schema::Diagnosis;
use ds_dynamics::traces::{Moment, POSITION, Series, Traces};

use super::markup::Markup;
use super::plot::{self, WIDTH, px};
use super::words;

/// Channels that are drawn beside the position.
const CHANNELS: usize = 4;
/// A channel is drawn from this ratio of before to floor.
const WORTH: f64 = 1.5;
const LEFT: f64 = 62.0;
const RIGHT: f64 = 940.0;
const TITLE: f64 = 26.0;
const AXIS: f64 = 26.0;

/// Writes the plots of one drive.
pub(crate) fn section(m: &mut Markup, diagnosis: &Diagnosis, traces: &Traces) {
    let drawn = drawn(traces);
    let kept = if traces.held_out { "kept from the fit" } else { "used for the fit" };
    m.inside("h3", &[], |m| {
        m.text(format_args!("Drive {} ", traces.drive));
        m.leaf("small", &[], format_args!("{kept}, {}", traces.file));
    });
    m.inside("ul", &[("class", &"legend")], |m| {
        for (class, words) in
            [("before", "nominal"), ("after", "corrected"), ("floor", "noise floor"), ("span", "gap significant")]
        {
            m.inside("li", &[], |m| {
                m.leaf("span", &[("class", &format_args!("swatch s-{class}")), ("aria-hidden", &"true")], "");
                m.text(words);
            });
        }
    });
    let ends = ends(&drawn);
    let heights: Vec<f64> = drawn.iter().map(|s| if s.name == POSITION { 150.0 } else { 96.0 }).collect();
    let height = heights.iter().sum::<f64>() + AXIS;
    let data = [px(ends.0), px(ends.1), px(LEFT), px(RIGHT)];
    let title = format!("Residuals of drive {} over time", traces.drive);
    m.inside(
        "div",
        &[
            ("class", &"scroll plot time"),
            ("data-drive", &traces.drive),
            ("data-from", &data[0]),
            ("data-to", &data[1]),
            ("data-left", &data[2]),
            ("data-right", &data[3]),
        ],
        |m| {
            plot::picture(m, "wide", &title, (WIDTH, height), |m| {
                let mut top = 0.0;
                for (series, height) in drawn.iter().zip(&heights) {
                    let spans = spans(diagnosis, traces.drive, series);
                    Panel::new(series, spans, ends, top, *height).draw(m);
                    top += height;
                }
                seconds(m, ends, top);
                m.void("line", &[("class", &"cursor"), ("x1", &0), ("x2", &0), ("y1", &px(TITLE)), ("y2", &px(top))]);
            });
        },
    );
}

/// Returns the series to draw: position, then the channels furthest above their floor.
fn drawn(traces: &Traces) -> Vec<&Series> {
    let ratio = |s: &Series| {
        let [before, _, floor] = s.roots();
        if floor > 0.0 { before / floor } else { 0.0 }
    };
    let mut channels: Vec<(f64, &Series)> =
        traces.series.iter().filter(|s| s.name != POSITION).map(|s| (ratio(s), s)).collect();
    channels.sort_by(|a, b| b.0.total_cmp(&a.0));
    let most = if channels.iter().any(|c| c.0 >= WORTH) { CHANNELS } else { 1 };
    let position = traces.series.iter().filter(|s| s.name == POSITION);
    position.chain(channels.iter().take(most).filter(|c| c.0 >= WORTH || most == 1).map(|c| c.1)).collect()
}

fn ends(series: &[&Series]) -> (f64, f64) {
    let stamps = series.iter().flat_map(|s| &s.moments).map(|moment| moment.secs);
    let (from, to) = stamps.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| (a.min(t), b.max(t)));
    if to > from { (from, to) } else { (0.0, 1.0) }
}

fn at(from: f64, to: f64, secs: f64) -> f64 {
    LEFT + (RIGHT - LEFT) * ((secs - from) / (to - from)).clamp(0.0, 1.0)
}

/// The plot of one series: its place, its scale and the spans to mark.
struct Panel<'a> {
    series: &'a Series,
    spans: Vec<(String, [f64; 2])>,
    ends: (f64, f64),
    high: f64,
    low: f64,
    reach: f64,
}

impl<'a> Panel<'a> {
    fn new(series: &'a Series, spans: Vec<(String, [f64; 2])>, ends: (f64, f64), top: f64, height: f64) -> Self {
        let largest = series.moments.iter().flat_map(|k| [k.before, k.after, k.floor]).fold(0.0, f64::max);
        let reach = if largest > 0.0 { largest * 1.04 } else { 1.0 };
        Self { series, spans, ends, high: top + TITLE, low: top + height - 8.0, reach }
    }

    fn y(&self, value: f64) -> f64 {
        self.low - (self.low - self.high) * (value / self.reach).clamp(0.0, 1.0)
    }

    fn points(&self, value: fn(&Moment) -> f64) -> Vec<(f64, f64)> {
        self.series.moments.iter().map(|k| (at(self.ends.0, self.ends.1, k.secs), self.y(value(k)))).collect()
    }

    fn draw(&self, m: &mut Markup) {
        self.scale(m);
        for (words, [from, to]) in &self.spans {
            let (x0, x1) = (at(self.ends.0, self.ends.1, *from), at(self.ends.0, self.ends.1, *to));
            plot::area(m, "span", (x0, self.high - 5.0), (x1 - x0, 3.5), words);
        }
        let before = self.points(|k| k.before);
        if let (Some(first), Some(last)) = (before.first(), before.last()) {
            let ground = [(last.0, self.low), (first.0, self.low)];
            let shape: Vec<_> = before.iter().copied().chain(ground).collect();
            m.void("polygon", &[("class", &"under"), ("points", &plot::joined(&shape))]);
        }
        plot::path(m, "floor", &self.points(|k| k.floor));
        plot::path(m, "before", &before);
        plot::path(m, "after", &self.points(|k| k.after));
        self.roots(m);
    }

    fn scale(&self, m: &mut Markup) {
        let steps = if self.low - self.high > 80.0 { 4.5 } else { 3.0 };
        let step = plot::round_above(self.reach / steps);
        let decimals = words::decimals(step, 1);
        for k in 0..=(self.reach / step) as usize {
            let y = self.y(k as f64 * step);
            plot::line(m, if k == 0 { "grid zero" } else { "grid" }, (LEFT, y), (RIGHT, y));
            plot::text(m, "tick end", (LEFT - 7.0, y + 4.0), &words::fixed(k as f64 * step, decimals));
        }
        let (title, unit) = words::metric(&key(self.series));
        plot::text(m, "name", (LEFT, self.high - 11.0), &format!("{}, {unit}", words::capital(&title)));
    }

    /// Writes the root mean squares, which are the legend of the curves as well.
    fn roots(&self, m: &mut Markup) {
        let texts = words::aligned(self.series.roots());
        let rows = [("t-before", "nominal"), ("t-after", "corrected"), ("t-floor", "floor")];
        for (k, ((class, what), text)) in rows.into_iter().zip(&texts).enumerate() {
            let y = self.low - 34.0 + 15.0 * k as f64;
            plot::text(m, class, (RIGHT + 14.0, y), what);
            plot::text(m, &format!("figure {class}"), (WIDTH - 20.0, y), text);
        }
        if self.series.name == POSITION {
            plot::text(m, "tick end", (WIDTH - 20.0, self.low - 50.0), "root mean square");
        }
    }
}

/// The key of a series as a metric.
fn key(series: &Series) -> String {
    if series.name == POSITION { series.name.clone() } else { format!("channel:{}", series.name) }
}

/// Spans of the significant cells of the whole drive in the channels of a series.
fn spans(diagnosis: &Diagnosis, drive: usize, series: &Series) -> Vec<(String, [f64; 2])> {
    let own = |channel: &str| {
        if series.name == POSITION { ["dx", "dy"].contains(&channel) } else { channel == series.name }
    };
    let whole = |c: &&ds_diagnosis::schema::Cell| {
        let r = &c.regime;
        r.drive == drive
            && own(&c.channel)
            && r.speed.is_none()
            && r.lateral.is_none()
            && r.pedal.is_none()
            && r.steering.is_none()
    };
    let mut all: Vec<[f64; 2]> = diagnosis.cells.iter().filter(whole).flat_map(|c| c.t.iter().copied()).collect();
    all.retain(|span| span.iter().all(|end| end.is_finite()));
    all.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut merged: Vec<[f64; 2]> = Vec::new();
    for span in all {
        match merged.last_mut() {
            Some(last) if span[0] <= last[1] => last[1] = last[1].max(span[1]),
            _ => merged.push(span),
        }
    }
    merged
        .into_iter()
        .map(|s| (format!("significant from {} to {} s", words::fixed(s[0], 1), words::fixed(s[1], 1)), s))
        .collect()
}

fn seconds(m: &mut Markup, ends: (f64, f64), top: f64) {
    let step = plot::round_above((ends.1 - ends.0) / 9.0);
    let mut tick = (ends.0 / step).ceil() * step;
    while tick <= ends.1 {
        plot::text(m, "tick", (at(ends.0, ends.1, tick), top + 10.0), &words::fixed(tick, words::decimals(step, 1)));
        tick += step;
    }
    plot::text(m, "tick begin", (RIGHT + 14.0, top + 10.0), "time, s");
}
