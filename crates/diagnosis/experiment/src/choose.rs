//! The manoeuvre to drive next: the library first, then a search from its best, then the envelope in many draws.

use ds_diagnosis::Diagnosis;
use ds_dynamics::case::Case;
use ds_dynamics::drive::MEASURED;
use ds_dynamics::motion::BuiltIn;
use ds_dynamics::settings::SENSOR_NOISE;
use ds_dynamics::standing::Standing;
use ds_dynamics::windows::EGO;
use ds_effect::Channel;
use ds_space::Draws;
use nalgebra::{DMatrix, DVector};

use crate::bound::entropy;
use crate::cma::{GENERATION, Search};
use crate::design::{Design, LIBRARY, SECS};
use crate::drive::World;
use crate::envelope::{Envelope, Margin, holds, tightest};
use crate::error::ExperimentError;
use crate::predict::{Expected, Predictor};
use crate::report::{CHANGED, Checked, Considered, Curve, Curves, GENTLER, Hypothesis, Next, Pair, Planned, SCHEMA};
use crate::settings::{ENOUGH, LEAST_NATS, Settings};

/// Most simulated drives of a search; the draws of the envelope come on top.
const ROLLOUTS: usize = 600;
/// Most hypotheses that are told apart.
const HYPOTHESES: usize = 5;
/// Least probability of one.
const LEAST: f64 = 0.01;
/// Draws of hypothesis and ordinary mismatch in which the envelope must hold: none of 300 leaves it, so that with a
/// confidence of 0.95 fewer than one in a hundred would.
const DRAWS: usize = 300;
/// Manoeuvres that are drawn, best first, before the best is driven more gently.
const DRAWN: usize = 8;
/// Factor on the accelerations of a manoeuvre for each time that it leaves the envelope, and how often at most.
const EASED: (f64, usize) = (0.85, 10);
/// Manoeuvres that are told of.
const TOLD: usize = 8;
/// Channels that are drawn.
const DRAWN_CHANNELS: usize = 3;
/// Samples between drawn ones.
const THINNED: usize = 2;

/// Designs the next run for what a diagnosis of a case leaves.
///
/// # Errors
/// If no manoeuvre stays within the envelope, or none is left.
pub fn choose(
    case: &Case,
    diagnosis: &Diagnosis,
    standings: &[Standing],
    settings: &Settings,
) -> Result<Next, ExperimentError> {
    settings.envelope.check()?;
    let kept = kept(standings);
    let mut next = open(diagnosis, &kept, settings.seed);
    if kept[0].probability >= ENOUGH {
        next.ended = Some(format!("settled: one hypothesis has a probability of {:.3}", kept[0].probability));
        return Ok(next);
    }
    let mut predictor = Predictor::new(case, &kept, &settings.envelope)?;
    let mut tried = search(&mut predictor, settings)?;
    let rollouts = predictor.rollouts;
    tried.sort_by(|a, b| b.1.worth.total_cmp(&a.1.worth));
    let worlds = worlds(&predictor, settings.seed);
    let (place, margins) = within(&mut predictor, &mut tried, &worlds, &settings.envelope)?;
    let told = tried.iter().enumerate().filter(|(k, _)| *k < TOLD || *k == place);
    let considered = told.map(|(k, (from, expected))| Considered {
        from: from.clone(),
        nats: expected.nats,
        holds: (k <= place).then_some(k == place),
    });
    let considered = considered.collect();
    let (from, best) = &tried[place];
    if best.nats < LEAST_NATS {
        let text =
            format!("no manoeuvre within the envelope tells {LEAST_NATS} nat or more; the best tells {:.3}", best.nats);
        next.ended = Some(text);
    }
    next.planned = Some(Planned {
        from: from.clone(),
        design: best.design.numbers(),
        secs: SECS,
        nats: best.nats,
        separates: separates(&kept, best),
        envelope: Checked { limits: settings.envelope, draws: DRAWS, margins },
        considered,
        rollouts,
        predicted: curves(&predictor, &best.design),
    });
    Ok(next)
}

/// Returns what hypotheses leave open, with no manoeuvre.
fn open(diagnosis: &Diagnosis, kept: &[Standing], seed: u64) -> Next {
    let probabilities: Vec<f64> = kept.iter().map(|s| s.probability).collect();
    let hypothesis = |s: &Standing| Hypothesis { effects: s.effects.clone(), probability: s.probability };
    Next {
        schema_version: SCHEMA,
        case: diagnosis.case.clone(),
        seed,
        hypotheses: kept.iter().map(hypothesis).collect(),
        p_unknown: diagnosis.p_unknown,
        entropy_nats: entropy(&probabilities),
        planned: None,
        runs: Vec::new(),
        refused: Vec::new(),
        ended: None,
    }
}

/// Returns what a diagnosis leaves open where no further run can be designed, and why.
pub(crate) fn ended(diagnosis: &Diagnosis, standings: &[Standing], seed: u64, why: &ExperimentError) -> Next {
    Next { ended: Some(why.in_words()), ..open(diagnosis, &kept(standings), seed) }
}

/// Returns the hypotheses that are likely enough, likeliest first, and the ordinary mismatch, against which effects have their
/// size.
fn kept(standings: &[Standing]) -> Vec<Standing> {
    let likely = standings.iter().enumerate().filter(|(k, s)| *k < HYPOTHESES && s.probability >= LEAST);
    let mut kept: Vec<Standing> = likely.map(|(_, s)| s.clone()).collect();
    if !kept.iter().any(|s| s.effects.is_empty()) {
        kept.extend(standings.iter().find(|s| s.effects.is_empty()).cloned());
    }
    let total: f64 = kept.iter().map(|s| s.probability).sum();
    kept.iter_mut().for_each(|s| s.probability /= total.max(1e-12));
    kept
}

/// Tries what is allowed of the library, then what an evolution strategy makes of its best, as long as simulated drives are left.
fn search(predictor: &mut Predictor<'_>, settings: &Settings) -> Result<Vec<(String, Expected)>, ExperimentError> {
    let heading = settings.envelope.site.and_then(|site| site.heading_rad);
    let turned = |design: Design| heading.map_or(design, |heading| design.pointing(heading));
    let mut tried = Vec::new();
    for (name, design) in LIBRARY.into_iter().filter(|(name, _)| !settings.without.iter().any(|w| w == name)) {
        tried.push((name.to_owned(), predictor.expect(&turned(design))?));
    }
    let worth = |e: &(String, Expected)| e.1.worth;
    let first = tried.iter().max_by(|a, b| worth(a).total_cmp(&worth(b))).ok_or(ExperimentError::NothingLeft)?;
    let from = format!("{}{CHANGED}", first.0);
    let mut evolution = Search::new(&first.1.design.shares(), Draws::from_seed(settings.seed, "next manoeuvre"));
    while predictor.rollouts + GENERATION * predictor.cost() <= ROLLOUTS {
        let mut generation = Vec::new();
        for point in evolution.ask() {
            generation.push((predictor.expect(&turned(Design::at(&point)))?, point));
        }
        generation.sort_by(|a, b| b.0.worth.total_cmp(&a.0.worth));
        let points: Vec<Vec<f64>> = generation.iter().map(|(_, point)| point.clone()).collect();
        evolution.tell(&points);
        tried.extend(generation.into_iter().map(|(expected, _)| (from.clone(), expected)));
    }
    Ok(tried)
}

/// Draws vectors of the car: a hypothesis by its probability, all that was fitted by its covariance.
fn worlds(predictor: &Predictor<'_>, seed: u64) -> Vec<Vec<f64>> {
    let draws = Draws::from_seed(seed, "envelope");
    let roots: Vec<DMatrix<f64>> = predictor.standings.iter().map(Standing::root).collect();
    let space = &predictor.space;
    let width = space.coordinates.len() as u64 + 1;
    let one = |draw: usize| {
        let first = draw as u64 * width;
        let mut left = draws.uniform(first);
        let likelier = |s: &Standing| {
            left -= s.probability;
            left < 0.0
        };
        let chosen = predictor.standings.iter().position(likelier).unwrap_or(0);
        let standing = &predictor.standings[chosen];
        let normal = DVector::from_fn(standing.free.len(), |k, _| draws.normal(first + 1 + k as u64));
        let mut vector = standing.vector.clone();
        for (k, moved) in standing.free.iter().zip((&roots[chosen] * normal).iter()) {
            let (low, high) = space.coordinates[*k].within();
            vector[*k] = (vector[*k] + moved).clamp(low, high);
        }
        vector
    };
    (0..DRAWS).map(one).collect()
}

/// Returns the place of the best manoeuvre that stays within the envelope in all draws, and its margins; where none of the
/// best does, the best is driven more gently and added to the list.
fn within(
    predictor: &mut Predictor<'_>,
    tried: &mut Vec<(String, Expected)>,
    worlds: &[Vec<f64>],
    envelope: &Envelope,
) -> Result<(usize, Vec<Margin>), ExperimentError> {
    let mut last = Vec::new();
    for (place, (_, expected)) in tried.iter().take(DRAWN).enumerate() {
        last = margins(predictor, &expected.design, worlds, envelope)?;
        if holds(&last) {
            return Ok((place, last));
        }
    }
    let (name, best) = (tried[0].0.clone(), tried[0].1.design);
    for k in 1..=EASED.1 {
        let gentle = best.gentler(EASED.0.powi(i32::try_from(k).unwrap_or(1)));
        last = margins(predictor, &gentle, worlds, envelope)?;
        if holds(&last) {
            let expected = predictor.expect(&gentle)?;
            let place = tried.len().min(DRAWN);
            tried.insert(place, (format!("{name}{GENTLER}"), expected));
            return Ok((place, last));
        }
    }
    let named = tightest(&last).map(|m| format!("{}: {:.2} of {:.2} {}", m.name, m.reached, m.limit, m.unit));
    let tried = tried.len().min(DRAWN) + EASED.1;
    Err(ExperimentError::NoneHolds { tried, draws: worlds.len(), worst: named.unwrap_or_default() })
}

fn margins(
    predictor: &Predictor<'_>,
    design: &Design,
    worlds: &[Vec<f64>],
    envelope: &Envelope,
) -> Result<Vec<Margin>, ExperimentError> {
    let mut driven = Vec::with_capacity(worlds.len());
    for vector in worlds {
        let plant = predictor.space.plant(vector);
        let world = World { motion: &BuiltIn, plant: &plant };
        let drive = world.drive(design, &predictor.case.meta.nominal, None).ok_or(ExperimentError::NotDriven)?;
        driven.push((drive.instants, plant.vehicle.friction));
    }
    Ok(envelope.margins(driven.iter().map(|(instants, friction)| (instants.as_slice(), *friction))))
}

fn separates(kept: &[Standing], best: &Expected) -> Vec<Pair> {
    let mut pairs = Vec::new();
    for (a, one) in kept.iter().enumerate() {
        for (b, other) in kept.iter().enumerate().skip(a + 1) {
            let (one, other) = (one.effects.clone(), other.effects.clone());
            pairs.push(Pair { one, other, nats: best.distances[a][b] });
        }
    }
    pairs.sort_by(|a, b| b.nats.total_cmp(&a.nats));
    pairs
}

/// Returns what each hypothesis predicts of the channels in which they differ most.
fn curves(predictor: &Predictor<'_>, design: &Design) -> Vec<Curves> {
    let drive = |s: &Standing| {
        let plant = predictor.space.plant(&s.vector);
        World { motion: &BuiltIn, plant: &plant }.drive(design, &predictor.case.meta.nominal, None)
    };
    let Some(driven) = predictor.standings.iter().map(drive).collect::<Option<Vec<_>>>() else { return Vec::new() };
    let noise = |channel: usize| SENSOR_NOISE[channel] * predictor.case.noise.ego[channel];
    let differs = |channel: usize| {
        let against = |(other, s): (&crate::drive::Driven, &Standing)| {
            let pairs = driven[0].readings.iter().zip(&other.readings);
            let squares: f64 = pairs.map(|(a, b)| (a[channel] - b[channel]).powi(2)).sum();
            s.probability * (squares.sqrt() / noise(channel)).ln_1p()
        };
        driven.iter().zip(predictor.standings).skip(1).map(against).sum::<f64>()
    };
    let present = predictor.case.drives[0].columns();
    let mut channels: Vec<usize> = (0..EGO).filter(|c| present.iter().any(|column| column.0 == MEASURED[*c])).collect();
    channels.sort_by(|a, b| differs(*b).total_cmp(&differs(*a)));
    channels.truncate(DRAWN_CHANNELS);
    let thin = |values: Vec<f64>| values.into_iter().step_by(THINNED).collect::<Vec<f64>>();
    let of = |channel: usize| Curves {
        channel: Channel::ALL[channel].name().to_owned(),
        t: thin(driven[0].stamps.clone()),
        each: driven
            .iter()
            .zip(predictor.standings)
            .map(|(d, s)| Curve {
                effects: s.effects.clone(),
                values: thin(d.readings.iter().map(|r| r[channel]).collect()),
            })
            .collect(),
        noise: noise(channel),
    };
    channels.into_iter().map(of).collect()
}
