//! A line plot with bands: figures by frame.

use ds_page::Markup;
use ds_page::svg::{joined, path, picture, text};

use crate::estimate::Estimate;

const WIDTH: f64 = 460.0;
const HEIGHT: f64 = 230.0;
/// Room for words: left, right, top, bottom.
const ROOM: [f64; 4] = [52.0, 12.0, 42.0, 26.0];

/// Width of a letter in the names of lines, at most on average.
const LETTER: f64 = 6.8;

/// A line with its band.
pub(crate) struct Line<'a> {
    name: &'a str,
    points: Vec<(f64, Estimate)>,
}

impl<'a> Line<'a> {
    /// Takes the points that are known.
    pub(crate) fn of(name: &'a str, points: &[(u32, Option<Estimate>)]) -> Self {
        Self { name, points: points.iter().filter_map(|(at, e)| e.map(|e| (f64::from(*at), e))).collect() }
    }
}

/// A plot of lines.
pub(crate) struct Plot<'a> {
    pub(crate) title: &'a str,
    pub(crate) lines: &'a [Line<'a>],
}

impl Plot<'_> {
    /// Draws the plot; nothing where no point is known.
    pub(crate) fn draw(&self, m: &mut Markup) {
        let points = || self.lines.iter().flat_map(|line| &line.points);
        let range = |values: Vec<f64>| {
            let low = values.iter().copied().fold(f64::INFINITY, f64::min);
            let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            if high > low { (low, high) } else { (low - 0.5, low + 0.5) }
        };
        if points().next().is_none() {
            return;
        }
        let (left, right) = range(points().map(|(x, _)| *x).collect());
        let (low, high) = range(points().flat_map(|(_, e)| [e.low, e.high, 0.0]).collect());
        let x = |at: f64| ROOM[0] + (at - left) / (right - left) * (WIDTH - ROOM[0] - ROOM[1]);
        let y = |at: f64| HEIGHT - ROOM[3] - (at - low) / (high - low) * (HEIGHT - ROOM[2] - ROOM[3]);
        picture(m, "inline", self.title, (WIDTH, HEIGHT), |m| {
            text(m, "title", (8.0, 16.0), self.title);
            let bottom = y(low);
            path(m, "axis", &[(x(left), y(high)), (x(left), bottom), (x(right), bottom)]);
            path(m, "axis", &[(x(left), y(0.0)), (x(right), y(0.0))]);
            text(m, "", (4.0, y(high) + 4.0), &format!("{high:.2}"));
            text(m, "", (4.0, bottom + 4.0), &format!("{low:.2}"));
            text(m, "", (x(left), HEIGHT - 8.0), &format!("frame {left:.0}"));
            text(m, "", (x(right) - 28.0, HEIGHT - 8.0), &format!("{right:.0}"));
            let mut named = x(left);
            for (index, one) in self.lines.iter().enumerate() {
                let colour = index % 4;
                let upper = one.points.iter().map(|(at, e)| (x(*at), y(e.high)));
                let lower = one.points.iter().rev().map(|(at, e)| (x(*at), y(e.low)));
                let band = joined(&upper.chain(lower).collect::<Vec<_>>());
                m.void("polygon", &[("class", &format!("band b{colour}")), ("points", &band)]);
                let points: Vec<(f64, f64)> = one.points.iter().map(|(at, e)| (x(*at), y(e.value))).collect();
                path(m, &format!("l{colour}"), &points);
                path(m, &format!("l{colour}"), &[(named, 28.0), (named + 14.0, 28.0)]);
                text(m, "", (named + 18.0, 32.0), one.name);
                named += 30.0 + LETTER * one.name.chars().count() as f64;
            }
        });
    }
}
