//! Where frames differ for a policy whose tokens are places: |c − c̃|² of each, for the scene of each source that differs most and
//! for the one in the middle, with the pictures that it is laid over.
//!
//! The unit is the variance of a place from one real frame to another (`ds_fidelity::TokenSpread`), over some scenarios that lie
//! evenly among all. Pictures show frames as policies see them, through the known camera.

use std::collections::BTreeMap;

use ds_fidelity::{TokenSpread, token_squares};
use ds_policy::camera::eye::Eye;
use ds_policy::{Context, Grid};

use super::features::contexts;
use super::found::{Found, HUNDREDTHS};
use super::outcome::Attended;
use super::source::Source;
use super::under_way::UnderWay;
use crate::error::EvaluationError;

/// Scenarios whose real frames make the unit, at most.
const UNIT_SCENES: usize = 16;

/// A scene that is shown of a source for a policy.
struct Shown {
    policy: usize,
    worst: bool,
    apart: f64,
    frame: u32,
}

/// Looks again at the frames that are shown, for each policy whose tokens are places.
///
/// # Errors
/// If a frame cannot be made or looked at, or a picture cannot be written.
pub(super) fn of(
    under_way: &UnderWay<'_>,
    found: &Found<'_>,
) -> Result<BTreeMap<String, Vec<Attended>>, EvaluationError> {
    let spreads = spreads(under_way)?;
    let mut scenes: BTreeMap<(usize, usize), Vec<Shown>> = BTreeMap::new();
    for (policy, spread) in spreads.iter().enumerate() {
        for (source, _) in found.config.others().filter(|_| spread.is_some()) {
            for (scene, shown) in chosen(found, policy, source) {
                scenes.entry((source, scene)).or_default().push(shown);
            }
        }
    }
    let scenes: Vec<((usize, usize), Vec<Shown>)> = scenes.into_iter().collect();
    let looked = under_way.crew.each(scenes.len(), |at| {
        let ((source, scene), shown) = &scenes[at];
        look(under_way, &found.config.sources[*source], *scene, shown, &spreads)
    })?;
    let mut all: BTreeMap<String, Vec<Attended>> = BTreeMap::new();
    for (policy, attended) in looked.into_iter().flatten() {
        all.entry(found.measured[policy].name.clone()).or_default().push(attended);
    }
    for attended in all.values_mut() {
        attended.sort_by(|a, b| a.source.cmp(&b.source).then(b.worst.cmp(&a.worst)));
    }
    Ok(all)
}

/// Returns the trace of the covariance of a place over real frames, by policy; none where tokens are no places.
fn spreads(under_way: &UnderWay<'_>) -> Result<Vec<Option<f64>>, EvaluationError> {
    let (real, looked) = (Source::reference(), under_way.config.looked());
    let count = under_way.takes.len().min(UNIT_SCENES);
    let seen = under_way.crew.each(count, |at| {
        let take = &under_way.takes[at * under_way.takes.len() / count];
        let (drive, frames) = under_way.frames(take, &real, under_way.config.frames)?;
        let mut lookers = under_way.crew.lookers();
        let looked = || looked.iter().map(|frame| &frames[*frame as usize]);
        let of = |member| contexts(member, &drive.model, looked(), &drive.name);
        lookers.panel.iter_mut().map(of).collect::<Result<Vec<Vec<Context>>, _>>()
    })?;
    let policies = seen.first().map_or(0, Vec::len);
    let one = |policy: usize| {
        let mut spread = TokenSpread::default();
        let all = || seen.iter().flat_map(|scene| &scene[policy]);
        all().for_each(|context| spread.add(context.tokens.values()));
        let channels = all().find(|context| context.grid.is_some())?.tokens.shape()[1];
        Some(spread.of_a_token(channels)).filter(|spread| *spread > 0.0)
    };
    Ok((0..policies).map(one).collect())
}

/// Returns the scene that differs most for a policy and the one in the middle, each with the frame that differs most.
fn chosen(found: &Found<'_>, policy: usize, source: usize) -> Vec<(usize, Shown)> {
    let (pairs, looked) = (&found.measured[policy].pairs[source], found.config.looked());
    let mean = |scene: usize| pairs[scene].iter().sum::<f64>() / pairs[scene].len() as f64;
    let mut order: Vec<usize> = (0..pairs.len()).collect();
    order.sort_by(|a, b| mean(*b).total_cmp(&mean(*a)).then(a.cmp(b)));
    let one = |(rank, worst): (usize, bool)| {
        let scene = order[rank];
        let most = (0..pairs[scene].len()).max_by(|a, b| pairs[scene][*a].total_cmp(&pairs[scene][*b])).unwrap_or(0);
        (scene, Shown { policy, worst, apart: mean(scene) * HUNDREDTHS, frame: looked[most] })
    };
    [(0, true), (order.len() / 2, false)].map(one).into()
}

/// Makes the frames of a scene once for all policies that show it.
fn look(
    under_way: &UnderWay<'_>,
    source: &Source,
    scene: usize,
    shown: &[Shown],
    spreads: &[Option<f64>],
) -> Result<Vec<(usize, Attended)>, EvaluationError> {
    let take = &under_way.takes[scene];
    let last = shown.iter().map(|shown| shown.frame).max().unwrap_or(0);
    let (drive, real) = under_way.frames(take, &Source::reference(), last)?;
    let (_, other) = under_way.frames(take, source, last)?;
    let (folder, mut eye) = (under_way.scenes()?, Eye::default());
    let mut lookers = under_way.crew.lookers();
    let mut all = Vec::new();
    for Shown { policy, worst, apart, frame } in shown {
        let pair = [&real, &other].map(|frames| &frames[*frame as usize]);
        let seen = contexts(&mut lookers.panel[*policy], &drive.model, pair.into_iter(), &drive.name)?;
        let ([of_real, of_other], Some(spread)) = (&seen[..], spreads[*policy]) else { continue };
        let Some(grid) = of_real.grid else { continue };
        let picture = format!("attended-{}-{}-{frame}.png", source.name(), take.scene.name);
        let row = pair.map(|frame| eye.look(&drive.model, frame)).to_vec();
        ds_train::sheet::write(&folder.join(&picture), &[row]).map_err(|source| EvaluationError::Stills { source })?;
        let (real, other) = (of_real.tokens.values(), of_other.tokens.values());
        let squares = token_squares(real, other, of_real.tokens.shape()[1]);
        let attended = Attended {
            source: source.name().to_owned(),
            scenario: take.scene.name.clone(),
            worst: *worst,
            apart: *apart,
            frame: *frame,
            picture,
            grid: grid.sides(),
            ground: matches!(grid, Grid::Ground(_)),
            places: squares.map(|square| square / spread).collect(),
        };
        all.push((*policy, attended));
    }
    Ok(all)
}
