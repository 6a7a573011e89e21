//! What stands under the tables of a report: as inline SVG how many values of each group lie where on a scale, and dots of many
//! series in one plane; two animations beside each other. Values in, markup out; every mark says in words what it is.

use ds_page::svg::{self, round_above};
use ds_page::{Markup, link};

/// Size of a plot, in pixels.
const SIZE_PX: (f64, f64) = (960.0, 300.0);
/// Where the plane of a plot begins and ends across, in pixels.
const ACROSS_PX: (f64, f64) = (60.0, 940.0);
/// Where it begins and ends downwards, in pixels.
const DOWN_PX: (f64, f64) = (18.0, 262.0);
/// Columns on the scale of a distribution, about.
const MOST_COLUMNS: f64 = 16.0;
/// Colours that groups and series take by turns.
const COLOURS: usize = 6;

/// A plot.
#[derive(Debug, Clone, PartialEq)]
pub enum Plot {
    /// A distribution.
    Columns(Columns),
    /// Dots.
    Scatter(Scatter),
    /// Two animations.
    Pair(Pair),
}

/// How many values of each group lie where on a scale from 0 on.
#[derive(Debug, Clone, PartialEq)]
pub struct Columns {
    /// What is shown, with its unit.
    pub title: String,
    /// Groups with their values.
    pub groups: Vec<(String, Vec<f64>)>,
}

/// Points across (from 0 on) and up (shares, shown in points of 100).
#[derive(Debug, Clone, PartialEq)]
pub struct Scatter {
    /// What is shown, with its units.
    pub title: String,
    /// The series.
    pub series: Vec<Series>,
}

/// Points of one colour.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// What they are of.
    pub name: String,
    /// The points.
    pub points: Vec<(f64, f64)>,
}

/// Two pictures in files beside the page.
#[derive(Debug, Clone, PartialEq)]
pub struct Pair {
    /// What is compared.
    pub title: String,
    /// Each picture, from the page's folder, and what it shows.
    pub pictures: [(String, String); 2],
}

impl Plot {
    /// Draws the plot.
    pub fn draw(&self, m: &mut Markup) {
        match self {
            Self::Columns(columns) => columns.draw(m),
            Self::Scatter(scatter) => scatter.draw(m),
            Self::Pair(pair) => pair.draw(m),
        }
    }
}

/// Writes a title and what the colours are.
fn head<'a>(m: &mut Markup, title: &str, names: impl Iterator<Item = &'a String>, colour: char) {
    m.leaf("h3", &[], title);
    m.inside("ul", &[("class", &"legend")], |m| {
        for (index, name) in names.enumerate() {
            m.inside("li", &[], |m| {
                let class = format!("swatch {colour}{}", index % COLOURS);
                m.inside("span", &[("class", &class), ("style", &"background: currentColor")], |_| ());
                m.text(name);
            });
        }
    });
}

/// Returns a place on a scale from `low` to `high`, in pixels from `from` to `to`.
fn place(value: f64, [low, high]: [f64; 2], (from, to): (f64, f64)) -> f64 {
    from + (to - from) * ((value - low) / (high - low)).clamp(0.0, 1.0)
}

impl Columns {
    /// Returns the width of a column and how many values of each group each holds.
    fn counted(&self) -> (f64, Vec<Vec<usize>>) {
        let most = self.groups.iter().flat_map(|(_, values)| values).copied().fold(0.0, f64::max);
        let width = round_above(most / MOST_COLUMNS);
        let columns = (most / width) as usize + 1;
        let mut counts = vec![vec![0; self.groups.len()]; columns];
        for (group, (_, values)) in self.groups.iter().enumerate() {
            for value in values {
                counts[((value.max(0.0) / width) as usize).min(columns - 1)][group] += 1;
            }
        }
        (width, counts)
    }

    fn draw(&self, m: &mut Markup) {
        let (width, counts) = self.counted();
        let highest = counts.iter().map(|column| column.iter().sum::<usize>()).max().unwrap_or(0).max(1);
        // Four steps of whole numbers.
        let (across, up) = ([0.0, width * counts.len() as f64], [0.0, 4.0 * highest.div_ceil(4) as f64]);
        head(m, &self.title, self.groups.iter().map(|(name, _)| name), 'p');
        svg::wide(m, &self.title, SIZE_PX, |m| {
            axis(m, up, |value| format!("{value:.0}"));
            let x = |value: f64| place(value, across, ACROSS_PX);
            let y = |count: usize| place(count as f64, up, (DOWN_PX.1, DOWN_PX.0));
            for (index, column) in counts.iter().enumerate() {
                let (left, right) = (index as f64 * width, (index + 1) as f64 * width);
                let mut below = 0;
                for (group, count) in column.iter().enumerate().filter(|(_, count)| **count > 0) {
                    let words = format!("{}: {count} from {left:.1} to {right:.1}", self.groups[group].0);
                    let corner = (x(left) + 1.0, y(below + count));
                    let size = (x(right) - x(left) - 2.0, y(below) - y(below + count));
                    m.inside("g", &[("class", &format_args!("p{}", group % COLOURS))], |m| {
                        svg::area(m, "dot", corner, size, &words);
                    });
                    below += count;
                }
                svg::text(m, "tick", (x(left), DOWN_PX.1 + 16.0), &format!("{left:.1}"));
            }
        });
    }
}

/// Draws five lines across with what they stand for.
fn axis(m: &mut Markup, scale: [f64; 2], told: impl Fn(f64) -> String) {
    for quarter in 0..=4 {
        let value = scale[0] + (scale[1] - scale[0]) * f64::from(quarter) / 4.0;
        let y = place(value, scale, (DOWN_PX.1, DOWN_PX.0));
        svg::line(m, "grid", (ACROSS_PX.0, y), (ACROSS_PX.1, y));
        svg::text(m, "label", (ACROSS_PX.0 - 8.0, y + 4.0), &told(value));
    }
}

impl Scatter {
    fn draw(&self, m: &mut Markup) {
        let all = || self.series.iter().flat_map(|series| &series.points);
        let across = [0.0, round_above(all().map(|(x, _)| *x).fold(0.0, f64::max))];
        let up = [if all().any(|(_, y)| *y < 0.0) { -1.0 } else { 0.0 }, 1.0];
        head(m, &self.title, self.series.iter().map(|series| &series.name), 'p');
        svg::wide(m, &self.title, SIZE_PX, |m| {
            axis(m, up, |value| format!("{:.0}", 100.0 * value));
            let x = |value: f64| place(value, across, ACROSS_PX);
            for tenth in 0..=10 {
                let value = across[1] * f64::from(tenth) / 10.0;
                svg::text(m, "tick", (x(value), DOWN_PX.1 + 16.0), &format!("{value:.1}"));
            }
            for (index, series) in self.series.iter().enumerate() {
                m.inside("g", &[("class", &format_args!("p{}", index % COLOURS))], |m| {
                    m.leaf("title", &[], svg::short(&series.name, 80));
                    for (across_at, up_at) in &series.points {
                        svg::dot(m, "dot", (x(*across_at), place(*up_at, up, (DOWN_PX.1, DOWN_PX.0))), 4.0);
                    }
                });
            }
        });
    }
}

impl Pair {
    fn draw(&self, m: &mut Markup) {
        m.leaf("h3", &[], &self.title);
        m.inside("ul", &[("class", &"cards")], |m| {
            for (path, words) in &self.pictures {
                m.inside("li", &[], |m| {
                    let (place, style) = (link(path), "aspect-ratio: auto; object-fit: contain");
                    m.void("img", &[("src", &place), ("alt", words), ("loading", &"lazy"), ("style", &style)]);
                    m.inside("div", &[], |m| m.leaf("p", &[], words));
                });
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_is_in_one_column() {
        let groups = vec![("a".to_owned(), vec![0.0, 3.0, 3.1]), ("b".to_owned(), vec![15.9, 16.0])];
        let columns = Columns { title: "speed".to_owned(), groups };
        let (width, counts) = columns.counted();
        assert!((width - 1.0).abs() < 1e-12 && counts.len() == 17, "{width} {counts:?}");
        assert_eq!(
            (&counts[0], &counts[3], &counts[15], &counts[16]),
            (&vec![1, 0], &vec![2, 0], &vec![0, 1], &vec![0, 1])
        );
        let mut m = Markup::default();
        Plot::Columns(columns).draw(&mut m);
        let drawn = m.finish();
        assert!(
            drawn.contains("<title>a: 2 from 3.0 to 4.0</title>") && drawn.matches("<rect").count() == 4,
            "{drawn}"
        );
        let nothing = Columns { title: String::new(), groups: Vec::new() };
        assert_eq!(nothing.counted().1, vec![Vec::<usize>::new()]);
    }

    #[test]
    fn dots_stand_where_their_values_are() {
        let series = vec![Series { name: "<a>".to_owned(), points: vec![(0.0, 0.0), (2.0, 1.0), (1.0, 0.5)] }];
        let mut m = Markup::default();
        Plot::Scatter(Scatter { title: "loss".to_owned(), series }).draw(&mut m);
        let drawn = m.finish();
        for part in ["cx=\"60\" cy=\"262\"", "cx=\"940\" cy=\"18\"", "cx=\"500\" cy=\"140\"", "&lt;a&gt;"] {
            assert!(drawn.contains(part), "{part} is missing in {drawn}");
        }
        assert!(!drawn.contains("<a>"));
    }
}
