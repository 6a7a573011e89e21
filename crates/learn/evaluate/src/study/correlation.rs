//! Whether the sources that are far are those on which policies plan badly.
//!
//! r_k is Pearson's, over sources, of a distance with policy k's open-loop PDMS on the source's frames. The distance of
//! FDπ is the mean FD of the *other* policies of the panel, so that no policy is judged by its own features; controls and
//! the look network stand beside it. The figure is the mean of r_k over the panel.

use std::collections::BTreeMap;

use ds_fidelity::{correlation, picks, recentred};
use ds_stats::{fisher, pearson, spearman};

use super::found::Found;
use super::outcome::{Correlation, Figure, Metric, Point};

/// The distance of one metric to each source, for each policy of the panel.
type Columns = Vec<Vec<f64>>;

/// Correlates all metrics.
pub(super) fn of(found: &Found<'_>) -> Correlation {
    let sources: Vec<usize> = found.config.others().map(|(at, _)| at).collect();
    let panel = found.panel();
    let all: Vec<usize> = (0..found.takes.len()).collect();
    let resamples: Vec<Vec<usize>> = picks(found.config.draws, found.takes.len()).collect();
    // PDMS of each policy of the panel on each source, over all scenarios and over those of each draw.
    let score = |picks: &[usize]| -> Columns {
        let one = |policy: &usize, source: &usize| mean_over(&found.pdms[*policy][source + 1], picks);
        panel.iter().map(|policy| sources.iter().map(|source| one(policy, source)).collect()).collect()
    };
    let scores = score(&all);
    let drawn_scores: Vec<Columns> = resamples.iter().map(|picks| score(picks)).collect();

    let metrics = metrics(found, &panel);
    let mut drawn = BTreeMap::new();
    let mut told = BTreeMap::new();
    for (name, networks) in &metrics {
        let columns =
            columns(networks, &sources, &|network, source| found.measured[network].value(found.config, source));
        let draws: Vec<f64> = (0..resamples.len())
            .map(|draw| {
                let of_draw = |network: usize, source: usize| found.measured[network].drawn[source][draw];
                mean_r(&self::columns(networks, &sources, &of_draw), &drawn_scores[draw]).unwrap_or(f64::NAN)
            })
            .collect();
        if let Some(metric) = metric(found, &panel, &sources, &columns, &scores, &draws) {
            told.insert(name.clone(), metric);
            drawn.insert(name.clone(), draws);
        }
    }
    let apart = |name: &&String| -> Option<(String, Figure)> {
        let (own, other) = (told.get("fd_pi")?, told.get(*name)?);
        let drawn = drawn["fd_pi"].iter().zip(&drawn[*name]).map(|(a, b)| a - b).collect();
        Some(((*name).clone(), Figure::of(recentred(own.r.value - other.r.value, drawn), 1.0)))
    };
    let apart = told.keys().filter(|name| *name != "fd_pi").collect::<Vec<_>>().iter().filter_map(apart).collect();
    let pdms = panel.iter().map(|policy| {
        let on = |at: usize| mean_over(&found.pdms[*policy][at], &all);
        let mut row = BTreeMap::from([("the real set".to_owned(), on(0))]);
        row.extend(found.config.others().map(|(at, source)| (source.name().to_owned(), on(at + 1))));
        (found.measured[*policy].name.clone(), row)
    });
    Correlation { sources: sources.len(), pdms: pdms.collect(), metrics: told, apart }
}

/// Lists the metrics: for each policy of the panel the networks whose distances are averaged.
fn metrics(found: &Found<'_>, panel: &[usize]) -> Vec<(String, Vec<Vec<usize>>)> {
    let others = |policy: &usize| panel.iter().copied().filter(|other| other != policy).collect();
    let mut all = vec![("fd_pi".to_owned(), panel.iter().map(others).collect())];
    all.push(("own features".to_owned(), panel.iter().map(|policy| vec![*policy]).collect()));
    for (at, measured) in found.measured.iter().enumerate().filter(|(_, measured)| measured.table.control) {
        all.push((measured.name.clone(), vec![vec![at]; panel.len()]));
    }
    all
}

fn columns(networks: &[Vec<usize>], sources: &[usize], value: &dyn Fn(usize, usize) -> f64) -> Columns {
    let mean = |networks: &Vec<usize>, source: usize| {
        networks.iter().map(|network| value(*network, source)).sum::<f64>() / networks.len() as f64
    };
    networks.iter().map(|networks| sources.iter().map(|source| mean(networks, *source)).collect()).collect()
}

/// Returns the mean of r_k; none where one has none.
fn mean_r(columns: &Columns, scores: &Columns) -> Option<f64> {
    let all: Option<Vec<f64>> = columns.iter().zip(scores).map(|(a, b)| pearson(a, b)).collect();
    all.map(|all| all.iter().sum::<f64>() / all.len() as f64)
}

fn metric(
    found: &Found<'_>,
    panel: &[usize],
    sources: &[usize],
    columns: &Columns,
    scores: &Columns,
    drawn: &[f64],
) -> Option<Metric> {
    let r = mean_r(columns, scores)?;
    let without = |left: usize| {
        let cut = |all: &Columns| -> Columns {
            let kept = |column: &Vec<f64>| {
                column.iter().enumerate().filter(|(at, _)| *at != left).map(|(_, value)| *value).collect()
            };
            all.iter().map(kept).collect()
        };
        mean_r(&cut(columns), &cut(scores))
    };
    let left_out: Vec<f64> = (0..sources.len()).filter_map(without).collect();
    let bound = |of: fn(f64, f64) -> f64| left_out.iter().copied().reduce(of).unwrap_or(r);
    let ranked: Vec<f64> = columns.iter().zip(scores).filter_map(|(a, b)| spearman(a, b)).collect();
    let name = |policy: &usize| found.measured[*policy].name.clone();
    let each = panel
        .iter()
        .zip(columns.iter().zip(scores))
        .filter_map(|(policy, (a, b))| Some((name(policy), pearson(a, b)?)));
    let points = panel.iter().zip(columns.iter().zip(scores)).flat_map(|(policy, (distances, scores))| {
        sources.iter().zip(distances.iter().zip(scores)).map(move |(source, (distance, pdms))| Point {
            policy: name(policy),
            source: found.config.sources[*source].name().to_owned(),
            distance: *distance,
            pdms: *pdms,
        })
    });
    Some(Metric {
        r: Figure::of(correlation(r, drawn), 1.0),
        of_sources: fisher(r, sources.len()),
        each: each.collect(),
        spearman: ranked.iter().sum::<f64>() / ranked.len().max(1) as f64,
        without_one: [bound(f64::min), bound(f64::max)],
        points: points.collect(),
    })
}

fn mean_over(scenarios: &[Vec<f64>], picks: &[usize]) -> f64 {
    let (sum, count) = picks.iter().fold((0.0, 0), |(sum, count), pick| {
        (sum + scenarios[*pick].iter().sum::<f64>(), count + scenarios[*pick].len())
    });
    sum / f64::from(u32::try_from(count).unwrap_or(u32::MAX)).max(1.0)
}
