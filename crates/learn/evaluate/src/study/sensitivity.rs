//! How much distances answer to edits of the world, and to hard scenarios.
//!
//! Of a pair (true, edited) the response of a metric is m(edited)/m(true) − 1: both made of the same scenarios, the edit
//! in the world and not in the pixels. Where the true source is the real set itself, at distance 0, the edited one's
//! distance is told in bootstrap deviations instead. Hard is the top quarter of a score of the scenarios alone: summed
//! ranks of agents within 30 m, of closeness ahead in seconds, of turning, and of the share of frames on junctions.

use std::collections::BTreeMap;

use ds_fidelity::{Compared, recentred};
use ds_space::plane::polygon::holds;
use ds_space::{Draws, Tick};
use ds_stats::ranks;
use ds_world::WorldState;

use super::found::Found;
use super::frames::Take;
use super::outcome::{Answer, Figure, Hard, Response, Sensitivity};
use crate::error::EvaluationError;

/// Random subsets that the hard one is compared with.
const SUBSETS: u64 = 200;
/// Agents within this distance count, in metres.
const NEAR_M: f64 = 30.0;
/// Half the width of the way ahead, in metres.
const AHEAD_HALF_M: f64 = 1.8;

/// Measures responses and the hard subset.
pub(super) fn of(found: &Found<'_>) -> Result<Sensitivity, EvaluationError> {
    let responses = found.config.edits.iter().filter_map(|pair| response(found, pair)).collect();
    Ok(Sensitivity { responses, hard: hard(found)? })
}

fn response(found: &Found<'_>, [before, after]: &[String; 2]) -> Option<Response> {
    let (before_at, after_at) = (found.config.place(before)?, found.config.place(after)?);
    let mut metrics = vec![("fd_pi".to_owned(), [before_at, after_at].map(|at| found.fd_pi(at)))];
    for measured in &found.measured {
        let of = |at: usize| (measured.value(found.config, at), measured.drawn[at].clone());
        metrics.push((measured.name.clone(), [before_at, after_at].map(of)));
    }
    let in_deviations = found.config.sources[before_at].is_real();
    let own = &metrics[0].1;
    let relative = |pair: &[(f64, Vec<f64>); 2]| {
        let drawn: Vec<f64> = pair[1].1.iter().zip(&pair[0].1).map(|(after, before)| after / before - 1.0).collect();
        (pair[1].0 / pair[0].0 - 1.0, drawn)
    };
    let answer = |(name, pair): &(String, [(f64, Vec<f64>); 2])| {
        if in_deviations {
            let deviations = pair[1].0 / deviation(&pair[1].1);
            return (name.clone(), Answer { response: Figure::exact(deviations), times: None });
        }
        let ((mine, my_draws), (value, drawn)) = (relative(own), relative(pair));
        let ratios = my_draws.iter().zip(&drawn).map(|(a, b)| a / b).collect();
        let response = Figure::of(recentred(value, drawn), 1.0);
        // A ratio to an answer that is not apart from none says nothing.
        let told = name != "fd_pi" && response.low > 0.0;
        let times = told.then(|| Figure::of(recentred(mine / value, ratios), 1.0));
        (name.clone(), Answer { response, times })
    };
    let answers: BTreeMap<String, Answer> = metrics.iter().map(answer).collect();
    Some(Response { before: before.clone(), after: after.clone(), in_deviations, answers })
}

fn deviation(drawn: &[f64]) -> f64 {
    let drawn: Vec<f64> = drawn.iter().copied().filter(|value| value.is_finite()).collect();
    let mean = drawn.iter().sum::<f64>() / drawn.len().max(1) as f64;
    (drawn.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (drawn.len() as f64 - 1.0).max(1.0)).sqrt()
}

/// Compares the hard quarter with random quarters, for every source.
fn hard(found: &Found<'_>) -> Result<Vec<Hard>, EvaluationError> {
    let scores = hardness(found.takes, &found.config.looked());
    let count = (found.takes.len() / 4).max(2);
    let mut order: Vec<usize> = (0..scores.len()).collect();
    order.sort_by(|a, b| scores[*b].total_cmp(&scores[*a]).then(a.cmp(b)));
    let hardest = &order[..count];
    let draws = Draws::from_seed(0, "subsets of equal size");
    let subset = |draw: u64| -> Vec<usize> {
        let mut order: Vec<usize> = (0..scores.len()).collect();
        order.sort_by_key(|at| draws.u64(draw * scores.len() as u64 + *at as u64));
        order.truncate(count);
        order
    };
    let subsets: Vec<Vec<usize>> = (0..SUBSETS).map(subset).collect();
    let panel = found.panel();
    let compared: Vec<Compared> = panel
        .iter()
        .map(|at| Compared::new(&found.sets[*at].name, found.sets[*at].real.clone()))
        .collect::<Result<_, _>>()?;
    let mut all = Vec::new();
    for (source, declared) in found.config.others() {
        let over = |picks: &[usize]| -> Result<f64, EvaluationError> {
            let mut sum = 0.0;
            for (at, compared) in panel.iter().zip(&compared) {
                sum += compared.over(declared.name(), &found.sets[*at].others[source], picks)?;
            }
            Ok(100.0 * sum / panel.len() as f64)
        };
        let (value, random) =
            (over(hardest)?, subsets.iter().map(|picks| over(picks)).collect::<Result<Vec<f64>, _>>()?);
        let mean = random.iter().sum::<f64>() / random.len() as f64;
        let above = random.iter().filter(|random| **random >= value).count() as f64;
        all.push(Hard {
            source: declared.name().to_owned(),
            scenarios: count,
            value,
            random: mean,
            more: value / mean - 1.0,
            p: (above + 1.0) / (random.len() as f64 + 1.0),
        });
    }
    Ok(all)
}

/// Returns the hardness of every scenario: the sum of its ranks in four respects.
fn hardness(takes: &[Take], looked: &[u32]) -> Vec<f64> {
    let mut respects: [Vec<f64>; 4] = Default::default();
    for take in takes {
        let worlds: Vec<WorldState> = looked.iter().map(|frame| take.scene.logged_world(Tick(*frame))).collect();
        let near = |world: &WorldState| {
            let ego = world.ego.pose.position;
            world.agents.iter().filter(|agent| agent.pose.position.distance(ego) <= NEAR_M).count() as f64
        };
        let junctions = &take.scene.map.junctions;
        let inside = |world: &&WorldState| junctions.iter().any(|area| holds(area, world.ego.pose.position));
        let turned = worlds
            .windows(2)
            .map(|pair| ds_space::angle::turn(pair[0].ego.pose.heading_rad, pair[1].ego.pose.heading_rad).abs());
        let values = [
            worlds.iter().map(near).sum::<f64>(),
            worlds.iter().map(closeness).fold(0.0, f64::max),
            turned.sum(),
            worlds.iter().filter(inside).count() as f64,
        ];
        respects.iter_mut().zip(values).for_each(|(all, value)| all.push(value));
    }
    let ranked = respects.map(|values| ranks(&values));
    (0..takes.len()).map(|at| ranked.iter().map(|ranks| ranks[at]).sum()).collect()
}

/// Returns one over the seconds to the nearest agent on the way ahead; 0 where there is none.
fn closeness(world: &WorldState) -> f64 {
    let speed_mps = world.ego.speed_mps().max(1.0);
    let ahead = |agent: &ds_world::AgentState| {
        let local = world.ego.pose.to_local(agent.pose.position);
        (local.x > 0.0 && local.y.abs() < AHEAD_HALF_M).then(|| speed_mps / local.x.max(0.1))
    };
    world.agents.iter().filter_map(ahead).fold(0.0, f64::max)
}
