//! The search over effects: ages first, then forward selection, each effect fitted on top of what was chosen before.
//!
//! Every effect is fitted where it shows (displacements, small pictures, full pictures, flat places, boxes) and then
//! judged by the same loss. An effect that is measured frame by frame or place by place pays for its freedom.

use std::cell::OnceCell;

use ds_effect::FrameEffect;
use ds_effect::frame::Act;
use ds_effect::frame_library;

use crate::align::{self, Ages, Field};
use crate::dirt::Map;
use crate::flicker;
use crate::geometry::moves;
use crate::grain;
use crate::loss::{self, Loss};
use crate::objects::{self, Event, Fate};
use crate::scene::{DETAIL, Model, Placed, Scene, known};
use crate::settings;
use crate::transport::Late;
use crate::{sharp, tone};

/// One effect tried on top of a model.
#[derive(Clone)]
pub struct Trial {
    /// Its id.
    pub id: &'static str,
    /// The model with it.
    pub model: Model,
    /// Its loss.
    pub loss: f64,
    /// What its freedom costs.
    pub cost: f64,
}

/// One round of the search.
pub struct Round {
    /// Loss before.
    pub before: f64,
    /// All trials, best first.
    pub trials: Vec<Trial>,
}

impl Round {
    /// Returns what a trial takes away beyond its cost.
    #[must_use]
    pub fn gain(&self, trial: &Trial) -> f64 {
        self.before - trial.loss - trial.cost
    }
}

/// What the search found.
pub struct Search {
    /// Rounds in order.
    pub rounds: Vec<Round>,
    /// Model with nuisance alone.
    pub null: Model,
    /// Its loss.
    pub null_loss: Loss,
    /// Chosen model.
    pub model: Model,
    /// Its loss.
    pub loss: Loss,
    /// Its placed frames.
    pub placed: Placed,
    /// Chosen effects in the order found.
    pub chosen: Vec<&'static str>,
    /// Ages of the content.
    pub ages: Ages,
    /// Displacements.
    pub field: Field,
}

/// What every search starts from: ages and displacements of the frames.
pub struct Ready {
    /// Ages of the content.
    pub ages: Ages,
    /// What they are held for.
    pub late: Late,
    /// Displacements.
    pub field: Field,
}

impl Ready {
    /// Measures a scene.
    #[must_use]
    pub fn of(scene: &Scene<'_>) -> Self {
        let ages = align::ages(scene);
        let late = crate::transport::judge(scene, &ages);
        let mut field = align::field(scene, &late.ages, ages.start);
        field.points.iter_mut().take(late.blind).for_each(Vec::clear);
        Self { ages, late, field }
    }
}

/// Searches.
#[must_use]
pub fn search(scene: &Scene<'_>, ready: Ready, without: &[String]) -> Search {
    let Ready { ages, late, field } = ready;
    let shifts = align::geometry(scene, &field, &Vec::new()).shifts;
    let null = Model { shifts, blind: late.blind, ..Model::nominal(scene.frames.len()) };
    let placed = scene.placed(&null);
    let null_loss = loss::measure(scene, &null, &placed);
    let mut found = Search {
        rounds: Vec::new(),
        model: null.clone(),
        loss: null_loss.clone(),
        null,
        null_loss,
        placed,
        chosen: Vec::new(),
        ages,
        field,
    };
    if let Some((effect, value)) = late.effect {
        found.model.ages = late.ages;
        found.model.set(effect, vec![value]);
        found.placed = scene.placed(&found.model);
        let loss = loss::measure(scene, &found.model, &found.placed);
        let trial = Trial { id: effect.id, model: found.model.clone(), loss: loss.total, cost: 0.0 };
        found.rounds.push(Round { before: found.loss.total.max(loss.total + late.evidence), trials: vec![trial] });
        found.chosen.push(effect.id);
        found.loss = loss;
    }
    while found.chosen.len() < settings::MOST_EFFECTS {
        let round = round(scene, &found, without);
        let Some(best) = round.trials.first().cloned() else { break };
        let gain = round.gain(&best);
        let taken = found.null_loss.total - found.loss.total;
        let needed = if found.chosen.is_empty() {
            settings::FIRST_GAIN
        } else {
            let fine = DETAIL.contains(&best.id) || ["sensor_noise", "motion_blur"].contains(&best.id);
            let share = match best.id {
                id if fate(id).is_some() => settings::FURTHER_OBJECTS_SHARE,
                _ if fine => settings::FURTHER_FINE_SHARE,
                _ => settings::FURTHER_SHARE,
            };
            settings::FURTHER_GAIN.max(share * taken)
        };
        found.rounds.push(round);
        if gain < needed {
            break;
        }
        found.placed = scene.placed(&best.model);
        found.model = polished(scene, best.model, &found.placed);
        found.loss = loss::measure(scene, &found.model, &found.placed);
        found.chosen.push(best.id);
    }
    found
}

/// What all trials of a round have in common, measured when it is first asked for.
#[derive(Default)]
struct Base {
    geometry_loss: OnceCell<f64>,
    events: OnceCell<Vec<Event>>,
}

fn round(scene: &Scene<'_>, found: &Search, without: &[String]) -> Round {
    let base = Base::default();
    let mut trials: Vec<Trial> = frame_library()
        .iter()
        .filter(|e| found.model.values(e.id).is_none() && !matches!(e.act, Act::Age(_)) && scene.can_show(e))
        .filter(|e| !without.iter().any(|w| w == e.id) && !hopeless(found, e))
        .filter_map(|e| trial(scene, found, &base, e))
        .filter(|t| !usual(t))
        .collect();
    trials.sort_by(|a, b| (a.loss + a.cost).total_cmp(&(b.loss + b.cost)));
    Round { before: found.loss.total, trials }
}

/// Fits all tone effects of a model once more, so that no later effect takes credit for an unfinished fit.
fn polished(scene: &Scene<'_>, model: Model, placed: &Placed) -> Model {
    let ids: Vec<&str> = model.effects.iter().map(|(e, _)| e.id).filter(|id| tone::KNOWN.contains(id)).collect();
    let mut model = if ids.is_empty() { model } else { tone::fit(scene, &model, &placed.small, &ids).0 };
    let fine: Vec<_> = model.effects.iter().filter(|(e, _)| !sharp::grid(e.id).is_empty()).map(|(e, _)| *e).collect();
    for effect in fine {
        model = sharp::refined(scene, model, placed, effect);
    }
    model
}

/// Tells whether an estimate lies within the mismatch that every case has.
fn usual(trial: &Trial) -> bool {
    let Some(values) = trial.model.values(trial.id) else { return false };
    let parameters = known(trial.id).parameters;
    let least = settings::LEAST_EFFECT * parameters[0].width();
    if parameters.len() > 1 && !moves(known(trial.id)) && (values[0] - parameters[0].neutral).abs() < least {
        return true;
    }
    parameters[0].nuisance.is_some()
        && parameters
            .iter()
            .zip(values)
            .all(|(p, v)| p.nuisance.is_none_or(|n| (v - n.mean).abs() < settings::MARGIN_SDS * n.sd))
}

/// Tells whether an effect made everything worse on top of a model whose frames were in place already.
fn hopeless(found: &Search, effect: &FrameEffect) -> bool {
    let placed = found.chosen.last().is_some_and(|id| !moves(known(id)));
    let Some(round) = found.rounds.last().filter(|_| placed) else { return false };
    round.trials.iter().any(|t| t.id == effect.id && round.gain(t) < settings::HOPELESS_GAIN)
}

fn trial(scene: &Scene<'_>, found: &Search, base: &Base, effect: &'static FrameEffect) -> Option<Trial> {
    let (model, loss, cost) = match effect.id {
        _ if moves(effect) => moving(scene, found, base, effect)?,
        "defocus" | "motion_blur" | "jpeg_loss" | "texture_washing" => {
            let (model, loss) = sharp::fit(scene, &found.model, &found.placed, effect);
            // a blur may be coarse enough to be seen as a first effect; as a further one it needs the finest band
            let fine = DETAIL.contains(&effect.id) || !found.chosen.is_empty();
            let loss = if fine { seen_in_detail(&found.loss, &loss) } else { loss.total };
            (model, loss, 3.0)
        }
        "sensor_noise" => {
            let model = noisy(scene, found, effect)?;
            let loss = loss::measure(scene, &model, &found.placed).total;
            (model, loss, 3.0)
        }
        "rain_streaks" => {
            let model = streaks(scene, found, effect)?;
            let loss = loss::measure(scene, &model, &found.placed).total;
            (model, loss, 6.0)
        }
        "lens_dirt" => {
            let (model, cost) = dirty(scene, found, effect)?;
            let loss = loss::measure(scene, &model, &found.placed).total;
            (model, loss, cost)
        }
        "temporal_flicker" => {
            let model = flickering(scene, found, effect)?;
            let loss = loss::measure(scene, &model, &found.placed).total;
            (model, loss, settings::FLICKER_COST)
        }
        "object_dropout" | "object_hallucination" | "identity_switch" | "layout_misalignment" => {
            let model = with_objects(scene, found, base, effect)?;
            let loss = loss::measure(scene, &model, &found.placed).total;
            let count: usize = model.lost.iter().map(Vec::len).sum();
            (model, loss, count as f64 * settings::COUNTED_FRAMES / scene.frames.len() as f64)
        }
        _ => toned(scene, found, effect),
    };
    Some(Trial { id: effect.id, model, loss, cost })
}

/// Returns the loss of an effect on fine detail: coarser bands, whose floors it raises, may confirm what the finest one
/// gains, but not more than that.
fn seen_in_detail(before: &Loss, after: &Loss) -> f64 {
    let gained = before.band(0) - after.band(0);
    let confirmed = (before.total - before.band(0)) - (after.total - after.band(0));
    before.total - gained - confirmed.min(gained.max(0.0))
}

/// Values from which a fit starts.
fn start(effect: &FrameEffect) -> Vec<f64> {
    match effect.id {
        "fog_haze" => vec![0.006, 0.75],
        "night_illumination" => vec![0.6, 0.3],
        "vignetting" => vec![0.2, 2.5],
        "exposure_lag" => vec![0.3],
        "rollout_drift" => vec![1.0, 0.07, 0.1],
        "white_balance" => vec![0.02, 0.02],
        "gamma" => vec![1.05],
        _ => effect.neutral(),
    }
}

fn moving(scene: &Scene<'_>, found: &Search, base: &Base, effect: &'static FrameEffect) -> Option<(Model, f64, f64)> {
    let before = base.geometry_loss.get_or_init(|| align::geometry(scene, &found.field, &found.model.effects).loss);
    let mut effects = found.model.effects.clone();
    effects.push((effect, start(effect)));
    let fit = align::geometry(scene, &found.field, &effects);
    if before - fit.loss < settings::GEOMETRY_GAIN {
        return None;
    }
    let mut model = found.model.clone();
    model.shifts = fit.shifts;
    for (effect, values) in fit.effects {
        model.set(effect, values);
    }
    let loss = loss::measure(scene, &model, &scene.placed(&model)).total;
    Some((model, loss, 2.0 + effect.parameters.len() as f64))
}

fn toned(scene: &Scene<'_>, found: &Search, effect: &'static FrameEffect) -> (Model, f64, f64) {
    let mut model = found.model.clone();
    model.set(effect, start(effect));
    let mut ids: Vec<&str> =
        found.model.effects.iter().map(|(e, _)| e.id).filter(|id| tone::KNOWN.contains(id)).collect();
    ids.push(effect.id);
    let (model, _) = tone::fit(scene, &model, &found.placed.small, &ids);
    let loss = loss::measure(scene, &model, &found.placed).total;
    (model, loss, 2.0 + effect.parameters.len() as f64)
}

fn noisy(scene: &Scene<'_>, found: &Search, effect: &'static FrameEffect) -> Option<Model> {
    let texture = grain::texture(scene, &scene.full_of(&found.model, &found.placed.full));
    // noise and encoder of every case are taken out
    let read = texture.read - settings::USUAL_NOISE;
    if texture.read + 0.5 * texture.shot < settings::FLAT_NOISE
        || texture.down > 0.25
        || texture.across > 0.25
        || texture.peak > 6.0
    {
        return None;
    }
    let mut model = found.model.clone();
    model.set(effect, vec![read.max(0.0).sqrt(), texture.shot.sqrt()]);
    Some(model)
}

fn streaks(scene: &Scene<'_>, found: &Search, effect: &'static FrameEffect) -> Option<Model> {
    let texture = grain::texture(scene, &scene.full_of(&found.model, &found.placed.full));
    if texture.down < texture.across + 0.12 || texture.down < 0.25 || texture.skew < 0.3 {
        return None;
    }
    let energy = (texture.read + 0.5 * texture.shot - settings::USUAL_NOISE).max(0.1);
    let (width, height) = (scene.case.size[0] as f64, scene.case.size[1] as f64);
    // streaks a tenth of the height long and one pixel wide; their strength follows from the skewness
    let strength = (texture.skew * (energy + settings::USUAL_NOISE).powf(1.5) / energy).clamp(10.0, 100.0);
    let count = energy / (strength * strength) * width * height / (0.1 * height);
    let mut model = found.model.clone();
    model.set(effect, vec![count, strength, energy]);
    Some(model)
}

fn flickering(scene: &Scene<'_>, found: &Search, effect: &'static FrameEffect) -> Option<Model> {
    let rendered = scene.small_of(&found.model, &found.placed.small);
    let fields: Vec<flicker::Field> =
        rendered.iter().zip(&scene.small).map(|(p, (_, q))| flicker::Field::measured(p, q, 0.1)).collect();
    let pattern = flicker::pattern(&fields);
    if pattern.sd < settings::LEAST_FLICKER || pattern.fixed > 0.5 || pattern.lasting > 0.5 {
        return None;
    }
    let mut model = found.model.clone();
    model.flicker = Some(fields);
    model.set(effect, vec![pattern.sd]);
    Some(model)
}

fn dirty(scene: &Scene<'_>, found: &Search, effect: &'static FrameEffect) -> Option<(Model, f64)> {
    let rendered = scene.small_of(&found.model, &found.placed.small);
    let real: Vec<_> = scene.small.iter().map(|(_, q)| q.clone()).collect();
    let mut map = Map::measured(&rendered, &real);
    let spots = map.spots();
    map.keep_spots();
    if spots.count == 0 || spots.area > settings::MOST_DIRT {
        return None;
    }
    let mut model = found.model.clone();
    model.set(effect, vec![spots.opacity, spots.count as f64, spots.veil]);
    model.dirt = Some(map);
    Some((model, settings::DIRT_COST[0] + settings::DIRT_COST[1] * spots.area))
}

/// Returns what an effect does to objects.
#[must_use]
pub fn fate(id: &str) -> Option<Fate> {
    match id {
        "object_dropout" => Some(Fate::Gone),
        "identity_switch" => Some(Fate::Restyled),
        "layout_misalignment" => Some(Fate::Moved),
        "object_hallucination" => Some(Fate::Appeared),
        _ => None,
    }
}

fn with_objects(scene: &Scene<'_>, found: &Search, base: &Base, effect: &'static FrameEffect) -> Option<Model> {
    let fate = fate(effect.id)?;
    let all = base.events.get_or_init(|| objects::events(scene, &scene.small_of(&found.model, &found.placed.small)));
    let events: Vec<Event> = all.iter().filter(|e| e.fate == fate).copied().collect();
    if events.is_empty() {
        return None;
    }
    let boxes = |cars: bool| -> usize {
        scene.frames.iter().map(|f| f.boxes.iter().filter(|b| !cars || b.class == "car").count()).sum()
    };
    let count = events.len() as f64;
    let square: f64 = events.iter().map(|e| 0.5 * (e.offset[0].powi(2) + e.offset[1].powi(2))).sum();
    let value = match fate {
        Fate::Gone => (count / boxes(true).max(1) as f64).min(1.0),
        Fate::Restyled => (count / boxes(false).max(1) as f64).min(1.0),
        Fate::Moved => (square / count).sqrt(),
        Fate::Appeared => count / scene.frames.len() as f64,
    };
    let mut model = found.model.clone();
    for event in events {
        model.lost[event.frame].push(event.edges);
    }
    model.set(effect, vec![value]);
    Some(model)
}
