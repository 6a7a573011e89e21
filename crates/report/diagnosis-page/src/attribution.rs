//! Which part of the world costs a policy how much of its score: shares as bars with intervals, scenario by scenario, and of
//! every metric.

use ds_run_report::Attribution;
use ds_run_report::attribution::InScenario;

use super::blocks::{head, section, table};
use super::markup::Markup;
use super::plot;
use super::words;

/// The metric that is drawn.
const SCORE: &str = "driving_score";
const LEFT: f64 = 190.0;
const RIGHT: f64 = 880.0;
const TOP: f64 = 40.0;
const ROW: f64 = 34.0;

/// The split of one policy's metrics.
#[derive(Debug, Clone, Copy)]
pub struct Attributed<'a> {
    /// The policy.
    pub policy: &'a str,
    /// What takes how much, in one sentence.
    pub sentence: &'a str,
    /// Metric by metric.
    pub metrics: &'a [Attribution],
}

/// Writes the body of the page.
pub(crate) fn body(m: &mut Markup, policies: &[Attributed<'_>], asked: &[(&str, String)]) {
    head(m, "Which part of the real world costs the score", |m| {
        for one in policies {
            let said = format!("{}: {}.", words::capital(one.policy), one.sentence);
            m.leaf("p", &[("class", &"said")], said);
        }
    });
    m.inside("main", &[], |m| {
        policies.iter().for_each(|one| policy(m, one));
        super::blocks::asked(m, asked);
        section(m, "How to read this", |m| {
            m.leaf(
                "p",
                &[],
                "Every combination of the nominal and the real world's parts was driven. The share of a part is its mean \
                 contribution over all orders in which parts could be swapped (Shapley); shares sum to the whole difference in \
                 every scenario. Points are hundredths of a score; below zero is lost in the real world. Whiskers are 95 % \
                 intervals over scenarios: a part whose whisker holds zero may cost nothing.",
            );
        });
    });
}

fn policy(m: &mut Markup, of: &Attributed<'_>) {
    section(m, of.policy, |m| {
        let Some(score) = of.metrics.iter().find(|split| split.metric == SCORE) else {
            m.leaf("p", &[("class", &"lead")], "No scenario has a driving score in every combination.");
            return;
        };
        let [nominal, real] = [score.nominal, score.real].map(points);
        let lead = format!(
            "Driving score {nominal} in the nominal world, {real} in the real one; {} scenarios.",
            score.scenarios
        );
        m.leaf("p", &[("class", &"lead")], lead);
        bars(m, score);
        m.leaf("h3", &[], "Scenario by scenario");
        let parts = score.shares.iter().map(|share| share.component.as_str());
        let columns: Vec<&str> = ["scenario", "all"].into_iter().chain(parts).collect();
        let row = |one: &InScenario| {
            let all = points(one.shares.iter().sum());
            [one.scenario.clone(), all].into_iter().chain(one.shares.iter().map(|share| points(*share))).collect()
        };
        table(m, "Scenario by scenario", &columns, &score.each.iter().map(row).collect::<Vec<_>>());
        m.leaf("h3", &[], "Every metric");
        let columns: Vec<&str> =
            ["metric", "nominal", "real"].into_iter().chain(columns[1..].iter().copied()).collect();
        let rows: Vec<Vec<String>> = of.metrics.iter().map(metric).collect();
        table(m, "Every metric", &columns, &rows);
    });
}

fn metric(split: &Attribution) -> Vec<String> {
    let with = |value: f64, range: Option<ds_run_report::Interval>| {
        let range = range.map_or(String::new(), |r| format!(" [{}, {}]", points(r.low), points(r.high)));
        format!("{}{range}", points(value))
    };
    let start =
        [words::metric(&split.metric).0, points(split.nominal), points(split.real), with(split.total, split.interval)];
    start.into_iter().chain(split.shares.iter().map(|share| with(share.value, share.interval))).collect()
}

/// Writes hundredths.
fn points(share: f64) -> String {
    words::fixed(100.0 * share, 1)
}

/// Draws the shares, the largest first, and their sum below.
fn bars(m: &mut Markup, score: &Attribution) {
    let mut rows: Vec<(&str, f64, Option<ds_run_report::Interval>)> =
        score.shares.iter().map(|share| (share.component.as_str(), share.value, share.interval)).collect();
    rows.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    rows.push(("all together", score.total, score.interval));
    let ends = rows.iter().flat_map(|row| [row.1, row.2.map_or(row.1, |r| r.low), row.2.map_or(row.1, |r| r.high)]);
    let (low, high) = ends.fold((0.0_f64, 0.0_f64), |(a, b), v| (a.min(v), b.max(v)));
    let room = (0.06 * (high - low)).max(1e-3);
    let (low, high) = (low - room, high + room);
    let x = |value: f64| LEFT + (RIGHT - LEFT) * (value - low) / (high - low);
    let height = TOP + ROW * rows.len() as f64 + 14.0;
    plot::wide(m, "Share of each part", height, |m| {
        let step = plot::round_above((high - low) / 6.0);
        let mut tick = (low / step).ceil() * step;
        while tick <= high {
            plot::line(
                m,
                if tick.abs() < 1e-9 { "zero" } else { "grid" },
                (x(tick), TOP - 8.0),
                (x(tick), height - 8.0),
            );
            plot::text(m, "tick", (x(tick), TOP - 16.0), &words::plain(100.0 * tick));
            tick += step;
        }
        plot::text(m, "tick begin", (RIGHT + 14.0, TOP - 16.0), "points");
        for (k, (name, value, range)) in rows.iter().enumerate() {
            let y = TOP + ROW * (k as f64 + 0.5);
            let sum = k + 1 == rows.len();
            plot::text(m, if sum { "label strong" } else { "label" }, (LEFT - 16.0, y + 4.5), name);
            let class = if sum { "p" } else { "p chosen" };
            let told = format!("{name}: {} points", points(*value));
            plot::area(m, class, (x(value.min(0.0)), y - 8.0), (x(value.abs()) - x(0.0), 16.0), &told);
            if let Some(range) = range {
                plot::line(m, "neutral", (x(range.low), y), (x(range.high), y));
                [range.low, range.high]
                    .iter()
                    .for_each(|end| plot::line(m, "neutral", (x(*end), y - 4.0), (x(*end), y + 4.0)));
            }
            plot::text(m, "tick begin", (RIGHT + 14.0, y + 4.5), &points(*value));
        }
    });
}

#[cfg(test)]
mod tests {
    use ds_run_report::attribute;

    use super::*;

    #[test]
    fn the_page_says_shares_scenarios_and_metrics() {
        let cells = [[0.9, 0.8], [0.7, 0.7], [0.8, 0.8], [0.5, 0.6]].map(|cell| cell.map(Some).to_vec());
        let split = attribute("driving_score", &["frames", "dynamics"], &["a <1>", "b"], &cells, 1).expect("a split");
        let sentence = split.sentence();
        let metrics = [split];
        let one = Attributed { policy: "camera", sentence: &sentence, metrics: &metrics };
        let page = crate::attribution(&[one], &[("seeds", "0".to_owned())]);
        for needed in ["Camera: of -30.0 points", "a &lt;1&gt;", "all together", "driving score", "−40.0", "seeds"] {
            assert!(page.contains(needed), "{needed} is not on the page");
        }
        let none = Attributed { metrics: &[], ..one };
        assert!(crate::attribution(&[none], &[]).contains("No scenario has a driving score"));
    }
}
