//! How far the gap shrinks: nominal and corrected agents over five seconds beside the recorded ones that no fit saw.
//!
//! Displacement at 1, 2, 3 and 5 s (root mean square, m), distance between the distributions of gaps after 5 s (mean
//! distance of order statistics, m), speed and place across the lane; intervals by a bootstrap over agents.

use ds_diagnosis::schema::Shrink;
use ds_space::Draws;
use ds_stats::bootstrap::resamples;
use ds_stats::quantile;

use crate::model::Traffic;
use crate::rollout::{Course, Manner, roll};
use crate::scenery::Mark;
use crate::settings::{ASIDE_FLOOR_M, DRAWS, LEFT_M, LEFT_MPS};

/// Instants of the displacement, s.
const INSTANTS: [f64; 4] = [1.0, 2.0, 3.0, 5.0];

/// What one agent shows of two simulators: squared errors and gaps.
#[derive(Default)]
struct Shown {
    /// By instant: sums of squared displacement before and after, count.
    places: [[f64; 3]; 4],
    /// Speed: the same.
    speed: [f64; 3],
    /// Gaps after 5 s: recorded, before, after.
    gaps: Vec<[f64; 3]>,
    /// Squared place across the lane: before, after, count.
    aside: [f64; 3],
}

/// Compares the nominal simulator and a corrected one on some agents.
#[must_use]
pub fn how_far(model: &Traffic, vectors: [&[f64]; 2], chosen: &[bool], data: &str) -> Vec<Shrink> {
    let manners = vectors.map(|vector| model.manner(vector));
    let offsets_m = vectors.map(|vector| model.space.value("lane_offset", vector).unwrap_or(0.0));
    let share = model.space.value("non_yielding", vectors[1]).unwrap_or(0.0);
    let shown: Vec<Shown> = (0..model.judged.len())
        .filter(|index| chosen[*index])
        .map(|index| show(model, index, &manners, offsets_m, share))
        .filter(|shown| shown.places[0][2] > 0.0)
        .collect();
    if shown.len() < 2 {
        return Vec::new();
    }
    let mut all = Vec::new();
    for (k, secs) in INSTANTS.into_iter().enumerate() {
        let floor = LEFT_M[k];
        let roots = move |drawn: &[&Shown]| roots(drawn.iter().map(|shown| shown.places[k]));
        all.push(shrink(&format!("position_{secs:.0}s"), &shown, floor, &roots, data));
    }
    all.push(shrink("channel:agent_v", &shown, LEFT_MPS, &|drawn| roots(drawn.iter().map(|s| s.speed)), data));
    if shown.iter().map(|shown| shown.gaps.len()).sum::<usize>() > 2 {
        all.push(shrink("gap_distribution_5s", &shown, 0.0, &gap_distances, data));
    }
    if shown.iter().any(|shown| shown.aside[2] > 0.0) {
        let floor = ASIDE_FLOOR_M[usize::from(!model.sceneries.iter().all(|scenery| scenery.expected))];
        all.push(shrink("channel:agent_lateral", &shown, floor, &|drawn| roots(drawn.iter().map(|s| s.aside)), data));
    }
    all
}

fn show(model: &Traffic, index: usize, manners: &[Manner; 2], offsets_m: [f64; 2], share: f64) -> Shown {
    let judged = &model.judged[index];
    let scenery = model.scenery(&judged.actor);
    let mut shown = Shown::default();
    if let Some(aside_m) = judged.aside_m() {
        shown.aside = [(aside_m - offsets_m[0]).powi(2), (aside_m - offsets_m[1]).powi(2), 1.0];
    }
    for &start in &judged.starts {
        let bare = roll(scenery, &judged.actor, start, &manners[0], true);
        // A simulator draws who yields; on the average it is right with the share of those who do.
        let full = roll(scenery, &judged.actor, start, &manners[1], true);
        let rude = (share > 0.0 && full.waited).then(|| roll(scenery, &judged.actor, start, &manners[1], false));
        let at = |secs: f64| (secs / scenery.dt_secs).round() as usize;
        let mark = |ticks: usize| judged.actor.marks.get(start + ticks).and_then(Option::as_ref);
        let square = |course: &Course, ticks: usize, mark: &Mark, which: usize| {
            let real = [mark.along_m, mark.speed_mps][which];
            course.states.get(ticks - 1).map_or(0.0, |state| (state[which] - real).powi(2))
        };
        let mixed = |ticks: usize, mark: &Mark, which: usize| {
            let courteous = square(&full, ticks, mark, which);
            rude.as_ref().map_or(courteous, |rude| (1.0 - share) * courteous + share * square(rude, ticks, mark, which))
        };
        for (k, ticks) in INSTANTS.map(at).into_iter().enumerate() {
            let Some(mark) = mark(ticks) else { continue };
            add(&mut shown.places[k], square(&bare, ticks, mark, 0), mixed(ticks, mark, 0));
            if k == 2 {
                add(&mut shown.speed, square(&bare, ticks, mark, 1), mixed(ticks, mark, 1));
            }
        }
        let last = at(INSTANTS[3]);
        let ends = [&bare, &full].map(|course| course.states.get(last - 1).map(|state| state[0]));
        if let (Some(mark), [Some(bare_m), Some(full_m)]) = (mark(last), ends)
            && let Some(lead) = mark.ahead.iter().find(|other| other.centre_m > mark.along_m + 0.1)
        {
            let gap = |along_m: f64| lead.rear_m - along_m - judged.actor.half_length_m;
            shown.gaps.push([gap(mark.along_m), gap(bare_m), gap(full_m)]);
        }
    }
    shown
}

fn add(sums: &mut [f64; 3], before: f64, after: f64) {
    sums[0] += before;
    sums[1] += after;
    sums[2] += 1.0;
}

fn roots(rows: impl Iterator<Item = [f64; 3]>) -> [f64; 2] {
    let sums = rows.fold([0.0; 3], |sums: [f64; 3], row| [sums[0] + row[0], sums[1] + row[1], sums[2] + row[2]]);
    [(sums[0] / sums[2].max(1.0)).sqrt(), (sums[1] / sums[2].max(1.0)).sqrt()]
}

fn gap_distances(drawn: &[&Shown]) -> [f64; 2] {
    let column = |which: usize| {
        let mut values: Vec<f64> = drawn.iter().flat_map(|shown| shown.gaps.iter().map(|gap| gap[which])).collect();
        values.sort_by(f64::total_cmp);
        values
    };
    let real = column(0);
    [1, 2].map(|which| {
        let apart = column(which).iter().zip(&real).map(|(a, b)| (a - b).abs()).sum::<f64>();
        apart / (real.len() as f64).max(1.0)
    })
}

fn shrink(metric: &str, shown: &[Shown], floor: f64, figures: &dyn Fn(&[&Shown]) -> [f64; 2], data: &str) -> Shrink {
    let share = |[before, after]: [f64; 2]| {
        let gap = before - floor;
        if gap <= 0.05 * floor.max(0.02) { 0.0 } else { (1.0 - (after - floor).max(0.0) / gap).clamp(-5.0, 1.0) }
    };
    let everyone: Vec<&Shown> = shown.iter().collect();
    let [before, after] = figures(&everyone);
    let draws = Draws::from_seed(2, metric);
    let mut shares: Vec<f64> = resamples(&draws, DRAWS, shown.len())
        .map(|picks| share(figures(&picks.into_iter().map(|pick| &shown[pick]).collect::<Vec<_>>())))
        .collect();
    Shrink {
        metric: metric.to_owned(),
        before,
        after,
        floor,
        share_explained: share([before, after]),
        interval90: [quantile(&mut shares, 0.05), quantile(&mut shares, 0.95)],
        data: data.to_owned(),
    }
}
