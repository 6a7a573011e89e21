//! How far the gap shrinks: nominal agents, those with the ordinary mismatch fitted and those with the effects added as
//! well, over five seconds beside the recorded ones that no fit saw.
//!
//! Displacement at 1, 2, 3 and 5 s (root mean square, m), distance between the distributions of gaps after 5 s (mean
//! distance of order statistics, m), speed and place across the lane; intervals by a bootstrap over agents.

use ds_diagnosis::schema::Shrink;
use ds_space::Draws;
use ds_stats::bootstrap::resamples;

use crate::model::Traffic;
use crate::rollout::{Course, Manner, roll};
use crate::scenery::Mark;
use crate::settings::{ASIDE_FLOOR_M, DRAWS, LEFT_M, LEFT_MPS};

/// Instants of the displacement, s.
const INSTANTS: [f64; 4] = [1.0, 2.0, 3.0, 5.0];

/// What one agent shows of the three simulators: squared errors and gaps.
#[derive(Default)]
struct AgentErrors {
    /// By instant: sums of squared displacement of each simulator, count.
    places: [[f64; 4]; 4],
    /// Speed: the same.
    speed: [f64; 4],
    /// Gaps after 5 s: of each simulator, recorded.
    gaps: Vec<[f64; 4]>,
    /// Squared place across the lane: of each simulator, count.
    aside: [f64; 4],
}

/// Simulators: nominal, with the ordinary mismatch, with the effects as well.
pub type States<'a> = [&'a [f64]; 3];

/// A simulator as it drives.
struct Driver {
    manner: Manner,
    offset_m: f64,
    /// Share of those who do not yield.
    rude: f64,
}

/// Compares the simulators on some agents.
#[must_use]
pub fn how_far(model: &Traffic, vectors: States<'_>, chosen: &[bool], data: &str) -> Vec<Shrink> {
    let value = |id: &str, vector: &[f64]| model.space.value(id, vector).unwrap_or(0.0);
    let drivers = vectors.map(|vector| Driver {
        manner: model.manner(vector),
        offset_m: value("lane_offset", vector),
        rude: value("non_yielding", vector),
    });
    let shown: Vec<AgentErrors> = (0..model.judged.len())
        .filter(|index| chosen[*index])
        .map(|index| show(model, index, &drivers))
        .filter(|shown| shown.places[0][3] > 0.0)
        .collect();
    if shown.len() < 2 {
        return Vec::new();
    }
    let mut all = Vec::new();
    for (k, secs) in INSTANTS.into_iter().enumerate() {
        let floor = LEFT_M[k];
        let roots = move |drawn: &[&AgentErrors]| roots(drawn.iter().map(|shown| shown.places[k]));
        all.push(shrink(&format!("position_{secs:.0}s"), &shown, floor, &roots, data));
    }
    all.push(shrink("channel:agent_v", &shown, LEFT_MPS, &|drawn| roots(drawn.iter().map(|s| s.speed)), data));
    if shown.iter().map(|shown| shown.gaps.len()).sum::<usize>() > 2 {
        all.push(shrink("gap_distribution_5s", &shown, 0.0, &gap_distances, data));
    }
    if shown.iter().any(|shown| shown.aside[3] > 0.0) {
        let floor = ASIDE_FLOOR_M[usize::from(!model.sceneries.iter().all(|scenery| scenery.expected))];
        all.push(shrink("channel:agent_lateral", &shown, floor, &|drawn| roots(drawn.iter().map(|s| s.aside)), data));
    }
    all
}

fn show(model: &Traffic, index: usize, drivers: &[Driver; 3]) -> AgentErrors {
    let judged = &model.judged[index];
    let scenery = model.scenery(&judged.actor);
    let mut shown = AgentErrors::default();
    if let Some(aside_m) = judged.aside_m() {
        shown.aside = with_count(drivers.each_ref().map(|driver| (aside_m - driver.offset_m).powi(2)));
    }
    for &start in &judged.starts {
        let rolled = drivers.each_ref().map(|driver| {
            let full = roll(scenery, &judged.actor, start, &driver.manner, true);
            // A simulator draws who yields; on the average it is right with the share of those who do.
            let rude =
                (driver.rude > 0.0 && full.waited).then(|| roll(scenery, &judged.actor, start, &driver.manner, false));
            (full, rude, driver.rude)
        });
        let at = |secs: f64| (secs / scenery.dt_secs).round() as usize;
        let mark = |ticks: usize| judged.actor.marks.get(start + ticks).and_then(Option::as_ref);
        let square = |course: &Course, ticks: usize, mark: &Mark, which: usize| {
            let real = [mark.along_m, mark.speed_mps][which];
            course.states.get(ticks - 1).map_or(0.0, |state| (state[which] - real).powi(2))
        };
        let squares = |ticks: usize, mark: &Mark, which: usize| {
            with_count(rolled.each_ref().map(|(full, rude, share)| {
                let courteous = square(full, ticks, mark, which);
                rude.as_ref()
                    .map_or(courteous, |rude| (1.0 - share) * courteous + share * square(rude, ticks, mark, which))
            }))
        };
        for (k, ticks) in INSTANTS.map(at).into_iter().enumerate() {
            let Some(mark) = mark(ticks) else { continue };
            add(&mut shown.places[k], squares(ticks, mark, 0));
            if k == 2 {
                add(&mut shown.speed, squares(ticks, mark, 1));
            }
        }
        let last = at(INSTANTS[3]);
        let ends = rolled.each_ref().map(|(full, ..)| full.states.get(last - 1).map(|state| state[0]));
        if let (Some(mark), [Some(a_m), Some(b_m), Some(c_m)]) = (mark(last), ends)
            && let Some(lead) = mark.ahead.iter().find(|other| other.centre_m > mark.along_m + 0.1)
        {
            let gap = |along_m: f64| lead.rear_m - along_m - judged.actor.half_length_m;
            shown.gaps.push([a_m, b_m, c_m, mark.along_m].map(gap));
        }
    }
    shown
}

fn with_count([a, b, c]: [f64; 3]) -> [f64; 4] {
    [a, b, c, 1.0]
}

fn add(sums: &mut [f64; 4], row: [f64; 4]) {
    sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
}

fn roots(rows: impl Iterator<Item = [f64; 4]>) -> [f64; 3] {
    let sums = rows.fold([0.0; 4], |mut sums, row| {
        add(&mut sums, row);
        sums
    });
    [0, 1, 2].map(|k| (sums[k] / sums[3].max(1.0)).sqrt())
}

fn gap_distances(drawn: &[&AgentErrors]) -> [f64; 3] {
    let column = |which: usize| {
        let mut values: Vec<f64> = drawn.iter().flat_map(|shown| shown.gaps.iter().map(|gap| gap[which])).collect();
        values.sort_by(f64::total_cmp);
        values
    };
    let real = column(3);
    [0, 1, 2].map(|which| {
        let apart = column(which).iter().zip(&real).map(|(a, b)| (a - b).abs()).sum::<f64>();
        apart / (real.len() as f64).max(1.0)
    })
}

fn shrink(
    metric: &str,
    shown: &[AgentErrors],
    floor: f64,
    figures: &dyn Fn(&[&AgentErrors]) -> [f64; 3],
    data: &str,
) -> Shrink {
    let states = |drawn: &[&AgentErrors]| {
        let [nominal, nuisance, corrected] = figures(drawn);
        [nominal, nuisance, corrected, floor]
    };
    let draws = Draws::from_seed(2, metric);
    let drawn: Vec<[f64; 4]> = resamples(&draws, DRAWS, shown.len())
        .map(|picks| states(&picks.into_iter().map(|pick| &shown[pick]).collect::<Vec<_>>()))
        .collect();
    Shrink::new(metric, states(&shown.iter().collect::<Vec<_>>()), &drawn, data)
}
