//! A short log leaves effects open; the loop drives what tells them apart, keeps the envelope, and the same seed drives the same.

use std::sync::atomic::{AtomicUsize, Ordering};

use ds_diagnosis::meta::VehicleMeta;
use ds_dynamics::case::Case;
use ds_dynamics::ego::{Actuated, Instant};
use ds_dynamics::motion::{BuiltIn, Motion, Window};
use ds_dynamics::{Options, diagnose_leaving, synthetic};
use ds_effect::{Plant, find};
use ds_experiment::{ENOUGH, Envelope, ExperimentError, Settings, Site, World, choose, run};

/// Ten seconds on a fast straight of a car with an effect, which tell little of most effects.
fn short(seed: u64, id: &str, value: f64) -> (Case, Plant) {
    let effect = |plant: &mut Plant| (find(id).expect("the effect is in the library").apply)(&[value], plant);
    let folder = tempfile::tempdir().expect("a folder");
    synthetic::write_case(folder.path(), seed, &effect).expect("the case can be written");
    let whole = Case::read(folder.path()).expect("the case can be read");
    let part = whole.drives[1].between(10.0, 20.0);
    let meta = VehicleMeta { drives: vec![whole.meta.drives[1].clone()], suggested_split: None, ..whole.meta.clone() };
    let mut plant = synthetic::usual(&whole.meta.nominal);
    effect(&mut plant);
    (Case::new(meta, vec![part]).expect("a case"), plant)
}

fn settings() -> Settings {
    Settings { seed: 5, envelope: Envelope::default(), quick: true, ..Settings::default() }
}

#[test]
fn what_a_short_log_leaves_open_is_settled_by_a_run_within_the_envelope() {
    let (case, plant) = short(61, "front_grip", 0.8);
    let (_, standings) = diagnose_leaving(&case, &Options { quick: true, ..Options::default() });
    assert!(standings[0].probability < 0.7, "{:?} {}", standings[0].effects, standings[0].probability);
    let drive = || run(&case, &World { motion: &BuiltIn, plant: &plant }, &settings(), &|_| ()).expect("it holds");
    let (next, logs, _) = drive();
    let last = next.runs.last().expect("something was open");
    assert_eq!((last.effects.as_slice(), logs.len()), (&["front_grip".to_owned()][..], next.runs.len()), "{next:#?}");
    assert!(last.probability >= ENOUGH && next.runs.len() <= 2, "{:#?}", next.runs);
    assert!(next.runs.iter().all(|r| !r.left_envelope && r.nats > 0.05), "{:#?}", next.runs);
    assert_eq!(drive().0, next);
}

/// A car whose drives report such speeds too much, the last from then on.
struct Faulty(AtomicUsize, &'static [f64]);

impl Motion for Faulty {
    fn roll(&self, windows: &[Window], actuated: &Actuated, plant: &Plant) -> Vec<Vec<Instant>> {
        let fault = self.1[self.0.fetch_add(1, Ordering::Relaxed).min(self.1.len() - 1)];
        let mut rolled = BuiltIn.roll(windows, actuated, plant);
        rolled.iter_mut().flatten().for_each(|instant| instant.v += fault);
        rolled
    }
}

#[test]
fn a_run_whose_log_is_refused_is_told_of_and_another_manoeuvre_driven() {
    let (case, plant) = short(61, "front_grip", 0.8);
    let motion = Faulty(AtomicUsize::new(0), &[1000.0, 0.0]);
    let world = World { motion: &motion, plant: &plant };
    let (next, logs, _) = run(&case, &world, &settings(), &|_| ()).expect("a second manoeuvre is driven");
    let [refused] = next.refused.as_slice() else { panic!("one log is refused: {next:#?}") };
    assert!(refused.run == 1 && refused.why.contains("km/h or another column?"), "{refused:#?}");
    let second = next.runs.first().expect("another run was driven");
    let begun = |from: &str| from.split(", changed").next().map(str::to_owned);
    assert_eq!((second.run, logs.len()), (2, next.runs.len()));
    assert_ne!(begun(&second.from), begun(&refused.from), "{next:#?}");
}

#[test]
fn who_does_not_answer_is_an_error_and_after_a_run_the_end() {
    let (case, plant) = short(61, "front_grip", 0.8);
    let faulty = |faults| {
        let motion = Faulty(AtomicUsize::new(0), faults);
        run(&case, &World { motion: &motion, plant: &plant }, &settings(), &|_| ())
    };
    let Err(error) = faulty(&[f64::NAN]) else { panic!("nothing was driven") };
    assert!(matches!(error, ExperimentError::NotDriven), "{error}");
    let (next, logs, _) = faulty(&[1000.0, f64::NAN]).expect("one run was driven before");
    assert_eq!((next.runs.len(), logs.len(), next.refused.len()), (0, 0, 1), "{next:#?}");
    assert!(next.ended.is_some_and(|ended| ended.contains("came to nothing")));
}

#[test]
fn a_proposal_keeps_the_site_and_what_cannot_be_kept_is_refused() {
    let (case, _) = short(61, "front_grip", 0.8);
    let (diagnosis, standings) = diagnose_leaving(&case, &Options { quick: true, ..Options::default() });
    let left = (&diagnosis, standings.as_slice());
    let site = Site { ahead_m: [-5.0, 420.0], left_m: [-90.0, 90.0], heading_rad: Some(0.5) };
    let bounded = Settings { envelope: Envelope { site: Some(site), ..Envelope::default() }, ..settings() };
    let planned = choose(&case, left.0, left.1, &bounded).expect("room enough").planned.expect("something is open");
    assert!(planned.rollouts <= 600 && planned.rollouts > 300, "{}", planned.rollouts);
    assert!(planned.nats > 0.05 && planned.envelope.draws == 300, "{planned:#?}");
    assert!(planned.envelope.margins.iter().all(|margin| margin.left >= 0.0), "{:#?}", planned.envelope.margins);
    assert!((planned.design["heading_rad"] - 0.5).abs() < 1e-12);
    assert!(planned.predicted.iter().all(|curves| curves.each.len() > 1));
    let short = Envelope { length_m: Some(150.0), curvature_per_m: Some(0.04), ..Envelope::default() };
    let short = Settings { envelope: short, ..settings() };
    let planned = choose(&case, left.0, left.1, &short).expect("a gentle way").planned.expect("something is open");
    for (name, limit) in [("length of the way", 150.0), ("curvature", 0.04)] {
        let margin = planned.envelope.margins.iter().find(|margin| margin.name == name).expect("it is told");
        assert!(margin.limit == limit && margin.reached <= limit && margin.left >= 0.0, "{margin:?}");
    }
    let narrow = Site { ahead_m: [-1.0, 4.0], left_m: [-1.0, 1.0], heading_rad: None };
    let narrow = Settings { envelope: Envelope { site: Some(narrow), ..Envelope::default() }, ..settings() };
    let refused = choose(&case, left.0, left.1, &narrow).expect_err("no car drives 16 s within 4 m");
    assert!(matches!(refused, ExperimentError::NoneHolds { .. }), "{refused}");
}
