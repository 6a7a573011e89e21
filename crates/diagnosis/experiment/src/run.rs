//! The loop: design a run, drive it in the world that stands for reality, add its log, diagnose again.

use ds_diagnosis::Diagnosis;
use ds_diagnosis::meta::DriveEntry;
use ds_diagnosis::table::Table;
use ds_dynamics::case::Case;
use ds_dynamics::drive::Drive;
use ds_dynamics::standing::Standing;
use ds_dynamics::{Options, diagnose_leaving};
use ds_space::Draws;

use crate::choose::choose;
use crate::design::Design;
use crate::drive::World;
use crate::envelope::{Margin, holds};
use crate::error::ExperimentError;
use crate::report::{Next, Run};
use crate::settings::{MOST_RUNS, Settings};

/// A run as it was driven.
pub struct Logged {
    /// Its log as a table.
    pub table: Table,
    /// Its log as a drive of the case.
    pub drive: Drive,
    /// What the car really left of the envelope.
    pub margins: Vec<Margin>,
}

/// Drives one manoeuvre in a world; its log has the noise of the case's sensors.
///
/// # Errors
/// If the drive comes to nothing, or its log makes no sense.
pub fn drive(
    world: &World<'_>,
    design: &Design,
    case: &Case,
    number: usize,
    settings: &Settings,
) -> Result<Logged, ExperimentError> {
    let draws = |of: &str| Draws::from_seed(settings.seed, &format!("run {number}, {of}"));
    let driven = world.drive(design, &case.meta.nominal, Some(&draws("jitter"))).ok_or(ExperimentError::NotDriven)?;
    let failed = |source| ExperimentError::Log { run: number, source };
    let table = driven.table(&file(number), case, Some(&draws("noise"))).map_err(failed)?;
    let entry = entry(number);
    let log = Drive::new(&table, None, &entry).map_err(failed)?;
    let friction = world.plant.vehicle.friction;
    let margins = settings.envelope.margins(std::iter::once((driven.instants.as_slice(), friction)));
    Ok(Logged { table, drive: log, margins })
}

/// Returns a case with the log of a run.
///
/// # Errors
/// If the log does not fit the case.
pub fn join(case: &Case, number: usize, log: Drive) -> Result<Case, ExperimentError> {
    case.joined(entry(number), log).map_err(|source| ExperimentError::Log { run: number, source })
}

fn file(number: usize) -> String {
    format!("run_{number}.csv")
}

fn entry(number: usize) -> DriveEntry {
    DriveEntry { file: file(number), ..DriveEntry::default() }
}

/// Diagnoses a case, drives what tells most of what that leaves, and goes on until one hypothesis is likely enough, nothing
/// more is to be learned or the runs are spent; `tell` hears of each run. Returns the state at the end, the logs that were
/// added and the last diagnosis.
///
/// # Errors
/// If no manoeuvre holds the envelope, or a drive comes to nothing.
pub fn run(
    case: &Case,
    world: &World<'_>,
    settings: &Settings,
    tell: &dyn Fn(&Run),
) -> Result<(Next, Vec<Table>, Diagnosis), ExperimentError> {
    let options = Options { quick: settings.quick, without: Vec::new() };
    let mut grown = case.clone();
    let (mut runs, mut logs): (Vec<Run>, Vec<Table>) = (Vec::new(), Vec::new());
    let mut found: (Diagnosis, Vec<Standing>) = diagnose_leaving(&grown, &options);
    loop {
        let mut next = choose(
            &grown,
            &found.0,
            &found.1,
            &Settings { seed: settings.seed + runs.len() as u64, ..settings.clone() },
        )?;
        next.seed = settings.seed;
        if runs.len() == MOST_RUNS && next.ended.is_none() {
            next.ended = Some(format!("{MOST_RUNS} runs were driven"));
        }
        let (Some(planned), None) = (&next.planned, &next.ended) else {
            return Ok((Next { runs, ..next }, logs, found.0));
        };
        let (number, design) = (runs.len() + 1, Design::named(&planned.design));
        let logged = drive(world, &design, case, number, settings)?;
        grown = join(&grown, number, logged.drive)?;
        found = diagnose_leaving(&grown, &options);
        let first = &found.1[0];
        let run = Run {
            run: number,
            file: file(number),
            from: planned.from.clone(),
            design: planned.design.clone(),
            nats: planned.nats,
            left_envelope: !holds(&logged.margins),
            margins: logged.margins,
            effects: first.effects.clone(),
            probability: first.probability,
            p_unknown: found.0.p_unknown,
        };
        tell(&run);
        runs.push(run);
        logs.push(logged.table);
    }
}
