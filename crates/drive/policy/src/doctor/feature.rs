//! Whether what a policy tells that it attends to is fit for FDπ: of one size, finite, of the frame and of the frame alone.

use ds_nn::Array;

use super::{Finding, Fixture};
use crate::Policy;
use crate::observation::Observation;

/// Features that differ by less than this share of their largest number are the same but for rounding.
const SAME_FEATURE: f32 = 1e-3;

/// Returns tokens and channels of what a policy tells that it attends to, if it does, or says what is wrong with it.
pub(super) fn of(policy: &mut dyn Policy, fixtures: &[Fixture]) -> Result<Option<[usize; 2]>, Finding> {
    let wrong = |says: String| Finding { check: "feature", says };
    let mut found: Vec<Option<Array>> = Vec::with_capacity(fixtures.len());
    for Fixture { name, observation, .. } in fixtures {
        let newest = observation.frames.iter().filter_map(|frames| frames.last().cloned());
        let told = policy.context(&observation.cameras, &newest.collect::<Vec<_>>());
        let tokens = told.map_err(|error| wrong(format!("fixture {name:?}: {error}")))?.map(|context| context.tokens);
        if tokens.as_ref().is_some_and(|tokens| !tokens.is_finite()) {
            return Err(wrong(format!("fixture {name:?}: a number of the feature is not finite")));
        }
        found.push(tokens);
    }
    let shape = |place: usize| found[place].as_ref().map(|tokens| tokens.shape().to_vec());
    if let Some(other) = (1..found.len()).find(|place| shape(*place) != shape(0)) {
        let says = |place: usize| {
            let shape = shape(place).map_or("no feature".to_owned(), |shape| format!("shape {shape:?}"));
            format!("{shape} for {:?}", fixtures[place].name)
        };
        return Err(wrong(format!("has {} and {}", says(0), says(other))));
    }
    let Some(Some(first)) = found.first() else { return Ok(None) };
    if found.len() > 1 && found.iter().flatten().all(|tokens| tokens == first) {
        let says = "the feature is the same for every frame: FDπ would be 0 for any source; a network of several frames is shown the same one \
                    as often, which has no motion";
        return Err(wrong(says.to_owned()));
    }
    match of_motion(policy, fixtures) {
        Some(says) => Err(wrong(says)),
        None => Ok(first.shape().try_into().ok()),
    }
}

/// Says whether what a policy tells with its answers changes with the car's motion or the command.
fn of_motion(policy: &mut dyn Policy, fixtures: &[Fixture]) -> Option<String> {
    fixtures.iter().enumerate().find_map(|(place, fixture)| {
        let other = &fixtures[(place + 1) % fixtures.len()].observation;
        let moved = Observation { ego: other.ego.clone(), command: other.command, ..fixture.observation.clone() };
        let mut told = |seen: &Observation| policy.plan(seen, None).ok()?.context.map(|context| context.tokens);
        let (before, after) = (told(&fixture.observation)?, told(&moved)?);
        let largest = before.values().iter().fold(0.0_f32, |most, value| most.max(value.abs()));
        let apart = before.values().iter().zip(after.values()).fold(0.0_f32, |most, (a, b)| most.max((a - b).abs()));
        (apart > SAME_FEATURE * largest).then(|| {
            format!(
                "fixture {:?}: the feature changes with the car's motion or the command: FDπ is of what depends on frames \
                 and calibration alone",
                fixture.name
            )
        })
    })
}
