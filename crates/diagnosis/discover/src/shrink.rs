//! How far a law shrinks the gap: on drives kept from the fit, else on every drive by a law fitted without it.

use ds_diagnosis::schema::{Corrected, Shrink};
use ds_dynamics::case::Case;
use ds_dynamics::diagnose::named;
use ds_dynamics::how_far::{States, how_far};
use ds_dynamics::space::Part;
use ds_effect::{Law, Plant, Port};

use crate::law::Refined;
use crate::port::Base;
use crate::settings::MOVED;

/// Returns the shrinks of all metrics of a law on some drives.
pub(crate) fn shrinks(
    case: &Case,
    part: Part,
    base: &Base<'_, '_>,
    found: &Refined,
    drives: &[usize],
    data: &str,
) -> Vec<Shrink> {
    let space = &base.model.space;
    let laws: Vec<Law> = found.law().into_iter().collect();
    let own = [
        space.plant(&space.neutral()),
        space.plant(found.nuisances()),
        Plant { laws, ..space.plant(found.nuisances()) },
    ];
    let other = [0, 1, 2].map(|_| case.meta.nominal.plant());
    let (own, other): (States<'_>, States<'_>) = (own.each_ref(), other.each_ref());
    let both = if part == Part::Ego { [&own, &other] } else { [&other, &own] };
    how_far(case, drives, both, data)
}

/// Returns the corrected simulator with a law in the place of effects: the nuisances beside it, and those of the other part as
/// they were.
pub(crate) fn corrected(before: &Corrected, base: &Base<'_, '_>, found: &Refined) -> Corrected {
    let space = &base.model.space;
    let of_space = |name: &str| space.find(name.split('.').next().unwrap_or(name)).is_some();
    let others = before.nuisance.iter().filter(|(name, _)| !of_space(name)).map(|(name, value)| (name.clone(), *value));
    let own = (0..space.effects.len()).flat_map(|effect| named(space, effect, found.nuisances()));
    let laws = found.law().iter().map(ToString::to_string).collect();
    Corrected { nuisance: others.chain(own).collect(), laws, ..Corrected::default() }
}

/// Tells whether a metric is one of followers.
pub(crate) fn is_of_followers(shrink: &Shrink) -> bool {
    shrink.metric.starts_with("channel:agent")
}

/// Returns the metric that tells most of a port: the way after two seconds of the car, the channel itself of a sensor; where
/// calibration leaves no gap there, the one that stands out most of those that the port moves.
pub(crate) fn of_port(port: Port, shrinks: &[Shrink]) -> Option<&Shrink> {
    let name = match port {
        Port::Sensor(channel) => format!("channel:{}", channel.name()),
        Port::Follower => "channel:agent_gap".to_owned(),
        _ => "position_2s".to_owned(),
    };
    let moved =
        |shrink: &Shrink| (shrink.after - shrink.nuisance.unwrap_or(shrink.before)).abs() > MOVED * shrink.floor;
    let known = |shrink: &&Shrink| {
        shrink.share_explained.is_some() && is_of_followers(shrink) == (port == Port::Follower) && moved(shrink)
    };
    let rise = |shrink: &Shrink| shrink.nuisance.unwrap_or(shrink.before) / shrink.floor.max(1e-12);
    let named = shrinks.iter().find(|shrink| shrink.share_explained.is_some() && shrink.metric == name);
    named.or_else(|| shrinks.iter().filter(known).max_by(|a, b| rise(a).total_cmp(&rise(b))))
}
