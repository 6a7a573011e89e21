//! The road of a drive seen from above, coloured by the position error after 2 s in units of the noise floor: once under
//! the nominal simulator, once under the corrected one. Turned so that it lies wide; both axes have one scale.

use ds_dynamics::traces::{Moment, POSITION, Traces};

use super::markup::Markup;
use super::plot::{self, joined, px};
use super::words;

/// Widest picture and highest one, px.
const SIZE: (f64, f64) = (1060.0, 420.0);
const MARGIN: f64 = 18.0;
/// Shortest drive that is worth a map, m.
const SHORTEST_M: f64 = 5.0;
/// Flattest map, px.
const FLATTEST: f64 = 40.0;

/// Tells whether there is anything to draw.
pub(crate) fn worth(traces: &Traces) -> bool {
    traces.path.len() > 2 && Turned::of(traces).width_m > SHORTEST_M && !errors(traces).is_empty()
}

fn errors(traces: &Traces) -> &[Moment] {
    traces.series.iter().find(|s| s.name == POSITION).map_or(&[], |s| s.moments.as_slice())
}

/// Writes both maps.
pub(crate) fn section(m: &mut Markup, traces: &Traces) {
    let turned = Turned::of(traces);
    let aspect = turned.height_m / turned.width_m;
    let beside = aspect > 0.22;
    let width = if beside { SIZE.0 / 2.0 } else { SIZE.0 };
    let per_m = ((width - 2.0 * MARGIN) / turned.width_m).min((SIZE.1 - 2.0 * MARGIN) / turned.height_m.max(1e-6));
    let height = (turned.height_m * per_m).max(FLATTEST) + 2.0 * MARGIN + 16.0;
    plot::level_legend(m, "position error after 2 s, times the floor (grey: at the floor)", 1);
    m.inside("div", &[("class", &(if beside { "maps beside" } else { "maps" })), ("data-drive", &traces.drive)], |m| {
        for (title, error) in
            [("Nominal simulator", (|k| k.before) as fn(&Moment) -> f64), ("Corrected simulator", |k| k.after)]
        {
            m.inside("figure", &[], |m| {
                m.leaf("figcaption", &[], title);
                let words = format!("Road of drive {}, {title}", traces.drive);
                plot::picture(m, "road", &words, (width, height), |m| {
                    map(m, traces, &turned, per_m, width, height, error);
                });
            });
        }
    });
}

fn map(
    m: &mut Markup,
    traces: &Traces,
    turned: &Turned,
    per_m: f64,
    width: f64,
    height: f64,
    error: fn(&Moment) -> f64,
) {
    let left = (width - turned.width_m * per_m) / 2.0;
    let middle = (height - 16.0) / 2.0;
    let place = |k: usize| {
        let (x, y) = turned.points[k];
        (left + x * per_m, middle - y * per_m)
    };
    plot::path(m, "way-ground", &(0..turned.points.len()).map(place).collect::<Vec<_>>());
    let moments = errors(traces);
    let mut next = 0;
    for k in 0..traces.path.len() - 1 {
        let secs = traces.path[k][0];
        while next + 1 < moments.len() && moments[next + 1].secs <= secs + 1e-6 {
            next += 1;
        }
        let moment = &moments[next];
        // before the first rollout and after the last nothing was measured
        if moment.secs > secs + 1e-6 || secs - moment.secs > 0.5 {
            continue;
        }
        let ratio = if moment.floor > 0.0 { error(moment) / moment.floor } else { 0.0 };
        let class = if ratio < plot::LEVELS[1] { "h" } else { plot::level(ratio) };
        m.void("polyline", &[("class", &class), ("points", &joined(&[place(k), place(k + 1)])), ("data-t", &px(secs))]);
    }
    let start = place(0);
    plot::dot(m, "start", start, 4.5);
    plot::dot(m, "here", start, 6.5);
    let length_m = plot::round_above(turned.width_m / 8.0);
    let (x, y) = (MARGIN, height - 8.0);
    plot::line(m, "rule", (x, y), (x + length_m * per_m, y));
    plot::text(m, "tick begin", (x + length_m * per_m + 8.0, y + 4.0), &format!("{} m", words::fixed(length_m, 0)));
    plot::text(m, "tick end", (width - MARGIN, y + 4.0), "ring: start");
}

/// The path turned by its principal axis, from (0, ±) on, in metres.
struct Turned {
    points: Vec<(f64, f64)>,
    width_m: f64,
    height_m: f64,
}

impl Turned {
    fn of(traces: &Traces) -> Self {
        let count = traces.path.len().max(1) as f64;
        let mean = |axis: usize| traces.path.iter().map(|p| p[axis]).sum::<f64>() / count;
        let (mx, my) = (mean(1), mean(2));
        let moment = |f: &dyn Fn(f64, f64) -> f64| traces.path.iter().map(|p| f(p[1] - mx, p[2] - my)).sum::<f64>();
        let (xx, yy, xy) = (moment(&|x, _| x * x), moment(&|_, y| y * y), moment(&|x, y| x * y));
        let (sin, cos) = (0.5 * (2.0 * xy).atan2(xx - yy)).sin_cos();
        let turn = |p: &[f64; 3]| ((p[1] - mx) * cos + (p[2] - my) * sin, (p[2] - my) * cos - (p[1] - mx) * sin);
        let mut points: Vec<(f64, f64)> = traces.path.iter().map(turn).collect();
        // the drive goes from left to right
        if points.first().zip(points.last()).is_some_and(|(first, last)| first.0 > last.0) {
            points.iter_mut().for_each(|p| *p = (-p.0, -p.1));
        }
        let ends = |f: fn(&(f64, f64)) -> f64| {
            points.iter().map(f).fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)))
        };
        let (x, y) = (ends(|p| p.0), ends(|p| p.1));
        points.iter_mut().for_each(|p| *p = (p.0 - x.0, p.1 - 0.5 * (y.0 + y.1)));
        Self { points, width_m: x.1 - x.0, height_m: y.1 - y.0 }
    }
}
