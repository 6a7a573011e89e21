//! The study `parts`: which part of a frame makes a policy plan otherwise than on the reference camera's frame.
//!
//! At a moment of a scenario a policy plans on the reference's frame r, on the source's frame s, and for each part p on s with
//! the reference's pixels of p and on r with the source's. Plans are as far apart as the places that they reach after 2 s, in
//! metres. What is taken away is |s − r| − |s with p − r|, what p does alone is |r with p − r|; means over moments, then over
//! scenarios, which are drawn anew for intervals. Parts act together: shares of a whole they are not.

mod part;

use std::collections::BTreeMap;

use ds_fidelity::{CONFIDENCE, picks};
use ds_raster::RgbImage;
use ds_space::{CameraModel, DVec2, SimTime};
use ds_stats::percentiles;
use serde::{Deserialize, Serialize};

use self::part::{Part, pasted};
use super::config::StudyConfig;
use super::features::Kept;
use super::frames::Take;
use super::moment::Moment;
use super::outcome::{Figure, FurthestApart, PartOf, Parts, PlansOf};
use super::panel::Member;
use super::source::Source;
use super::under_way::UnderWay;
use crate::Progress;
use crate::error::EvaluationError;

/// When places are compared, in seconds; of a plan that ends before, its end.
const AFTER_SECS: f64 = 2.0;
/// Moments that are shown of each source, of a scenario each.
const SHOWN: usize = 4;

/// What is kept of one scenario as one source shows it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Planned {
    /// By moment: the share of each part.
    shares: Vec<[f64; Part::COUNT]>,
    /// By policy that is no control, then moment.
    plans: Vec<Vec<Plans>>,
}

/// The plans of one policy at one moment, in metres.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Plans {
    /// |s − r|.
    apart: f64,
    /// How much further along the rig's x axis s goes.
    ahead: f64,
    /// By part: |s with p − r|.
    with: [f64; Part::COUNT],
    /// By part: |r with p − r|.
    alone: [f64; Part::COUNT],
}

/// One moment as reference and source show it.
struct Pair {
    moment: Moment,
    real: RgbImage,
    shown: RgbImage,
    parts: Vec<Part>,
}

impl Pair {
    /// Compares what a policy plans on the two frames, and on those with a part of the other.
    fn plans(&self, member: &mut Member, camera: &CameraModel) -> Result<Plans, EvaluationError> {
        let mut place = |frame: &RgbImage| -> Result<DVec2, EvaluationError> {
            let plan = self.moment.plan(member, camera, frame)?;
            Ok(plan.at(SimTime::from_secs(AFTER_SECS)).position)
        };
        let (real, shown) = (place(&self.real)?, place(&self.shown)?);
        let apart = shown.distance(real);
        let mut plans = Plans { apart, ahead: shown.x - real.x, with: [apart; Part::COUNT], alone: [0.0; Part::COUNT] };
        for (at, part) in Part::ALL.into_iter().enumerate() {
            // A part that is not there changes no frame.
            if self.parts.contains(&part) {
                plans.with[at] = place(&pasted(&self.shown, &self.real, &self.parts, part))?.distance(real);
                plans.alone[at] = place(&pasted(&self.real, &self.shown, &self.parts, part))?.distance(real);
            }
        }
        Ok(plans)
    }
}

/// Makes the frames of all sources, has policies plan on them and with parts of them, and compares.
///
/// # Errors
/// If a frame cannot be made or a policy cannot plan on one.
pub(super) fn of(
    config: &StudyConfig,
    under_way: &mut UnderWay<'_>,
    progress: &mut dyn Progress,
    seconds: &dyn Fn() -> f64,
) -> Result<Parts, EvaluationError> {
    let sources: Vec<&Source> = config.sources.iter().collect();
    let plan = |take: &Take, source: &Source| planned(config, under_way, take, source);
    let (planned, took) = under_way.each_set(Kept::Parts, &sources, &plan, progress, seconds)?;
    under_way.seconds = took;
    let policies: Vec<&str> =
        config.panel.iter().filter(|member| !member.control).map(|member| member.name.as_str()).collect();
    let mut found = Parts::default();
    for (at, source) in sources.iter().enumerate() {
        let scenarios: Vec<&Planned> = planned.iter().map(|sources| &*sources[at]).collect();
        let of_policy = |(policy, name): (usize, &&str)| ((*name).to_owned(), summed(&scenarios, policy, config.draws));
        found.sources.insert(source.name().to_owned(), policies.iter().enumerate().map(of_policy).collect());
        if !source.is_real() {
            let furthest = furthest(config, &under_way.takes, source, &scenarios);
            found.furthest.insert(source.name().to_owned(), furthest);
        }
    }
    Ok(found)
}

/// Has every policy that is no control plan at the moments of a scenario as a source shows it.
fn planned(
    config: &StudyConfig,
    under_way: &UnderWay<'_>,
    take: &Take,
    source: &Source,
) -> Result<Planned, EvaluationError> {
    let looked = config.looked();
    let last = looked.last().copied().unwrap_or(0);
    let (_, frames) = under_way.frames(take, source, last)?;
    let mut drive = under_way.drive(take, &Source::reference())?;
    let mut pair = |frame: &u32| {
        let world = take.world(&drive, *frame);
        let (real, layout) = (drive.frame_of(&world)?, drive.layout_of(&world)?.image);
        let shown = frames[*frame as usize].clone();
        Ok(Pair { moment: Moment::new(&take.scene, world)?, real, shown, parts: part::of(&layout) })
    };
    let pairs: Vec<Pair> = looked.iter().map(&mut pair).collect::<Result<_, EvaluationError>>()?;
    let mut lookers = under_way.crew.lookers();
    let members = lookers.panel.iter_mut().filter(|member| !member.control);
    let of_member = |member: &mut Member| pairs.iter().map(|pair| pair.plans(member, &drive.model)).collect();
    let plans = members.map(of_member).collect::<Result<_, EvaluationError>>()?;
    Ok(Planned { shares: pairs.iter().map(|pair| part::shares(&pair.parts)).collect(), plans })
}

/// Sums up what one policy planned on the frames of one source, over scenarios.
fn summed(scenarios: &[&Planned], policy: usize, draws: u64) -> PlansOf {
    let picks: Vec<Vec<usize>> = picks(draws, scenarios.len()).collect();
    let over = |of: &dyn Fn(&Planned) -> f64| {
        let values: Vec<f64> = scenarios.iter().map(|planned| of(planned)).collect();
        figure(&values, &picks)
    };
    let plans = |value: &dyn Fn(&Plans) -> f64| over(&|planned| mean(planned.plans[policy].iter().map(value)));
    let part = |(at, part): (usize, Part)| PartOf {
        part: part.name().to_owned(),
        taken_away_m: plans(&|plans| plans.apart - plans.with[at]),
        alone_m: plans(&|plans| plans.alone[at]),
        share: over(&|planned| mean(planned.shares.iter().map(|shares| shares[at]))),
    };
    let mut parts: Vec<PartOf> = Part::ALL.into_iter().enumerate().map(part).collect();
    parts.sort_by(|a, b| b.taken_away_m.value.total_cmp(&a.taken_away_m.value));
    PlansOf {
        moments: scenarios.iter().map(|planned| planned.shares.len()).sum(),
        apart_m: plans(&|plans| plans.apart),
        ahead_m: plans(&|plans| plans.ahead),
        parts,
    }
}

/// Returns the mean over scenarios with its interval: quantiles of the resamples, for a mean that is drawn anew has no bias, and so
/// no share lies below zero.
fn figure(values: &[f64], picks: &[Vec<usize>]) -> Figure {
    let drawn = picks.iter().map(|picks| mean(picks.iter().map(|pick| values[*pick]))).collect();
    let value = mean(values.iter().copied());
    let [low, high] = percentiles(drawn, 0.5 * (1.0 - CONFIDENCE)).unwrap_or([value; 2]);
    Figure { value, low, high }
}

/// Returns the mean; 0 of none.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    ds_stats::mean(values).unwrap_or(0.0)
}

/// Ranks scenarios by the moment at which plans on a source are furthest apart, mean over policies; the first are to be shown.
fn furthest(config: &StudyConfig, takes: &[Take], source: &Source, scenarios: &[&Planned]) -> Vec<FurthestApart> {
    let looked = config.looked();
    let of_scenario = |(take, planned): (&Take, &&Planned)| {
        let over = |moment: usize, value: &dyn Fn(&Plans) -> f64| {
            mean(planned.plans.iter().map(|plans| value(&plans[moment])))
        };
        let apart = |moment: usize| over(moment, &|plans| plans.apart);
        let most = (0..looked.len()).fold(0, |most, at| if apart(at) > apart(most) { at } else { most });
        let taken = Part::ALL.into_iter().enumerate();
        let taken = taken.map(|(at, part)| (part.name(), over(most, &|plans| plans.apart - plans.with[at])));
        let taken: BTreeMap<String, f64> = taken.map(|(part, value)| (part.to_owned(), value)).collect();
        let (scenario, frame) = (take.scene.name.clone(), looked[most]);
        FurthestApart {
            picture: format!("{}-{scenario}-{frame}.png", source.name()),
            scenario,
            frame,
            apart_m: apart(most),
            ahead_m: over(most, &|plans| plans.ahead),
            taken_away_m: taken,
        }
    };
    let mut all: Vec<FurthestApart> = takes.iter().zip(scenarios).map(of_scenario).collect();
    all.sort_by(|a, b| b.apart_m.total_cmp(&a.apart_m));
    all.truncate(SHOWN);
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_taken_away_is_a_mean_over_scenarios_and_sorted() {
        let plans = |apart: f64, paint: f64| {
            let mut plans = Plans { apart, ahead: -apart, with: [apart; 10], alone: [0.0; 10] };
            (plans.with[Part::Paint as usize], plans.alone[Part::Paint as usize]) = (paint, 0.5);
            plans
        };
        let planned = |all: [Plans; 2]| Planned { shares: vec![[0.1; 10]; 2], plans: vec![all.to_vec()] };
        let [one, two] = [planned([plans(1.0, 0.0), plans(3.0, 2.0)]), planned([plans(2.0, 1.0), plans(2.0, 3.0)])];
        let found = summed(&[&one, &two], 0, 100);
        assert_eq!((found.moments, found.apart_m.value, found.ahead_m.value), (4, 2.0, -2.0));
        let first = &found.parts[0];
        assert_eq!((first.part.as_str(), first.taken_away_m.value, first.alone_m.value), ("paint", 0.5, 0.5));
        assert!(first.taken_away_m.low < 0.5 && first.taken_away_m.high > 0.5, "1 in one scenario, 0 in the other");
        assert!(found.parts[1..].iter().all(|part| part.taken_away_m.value == 0.0));
    }
}
