//! The loop: design a run, drive it in the world that stands for reality, add its log, diagnose again.

use ds_diagnosis::Diagnosis;
use ds_diagnosis::meta::DriveEntry;
use ds_diagnosis::table::Table;
use ds_dynamics::case::Case;
use ds_dynamics::drive::Drive;
use ds_dynamics::standing::Standing;
use ds_dynamics::{Options, diagnose_leaving};
use ds_space::Draws;

use crate::choose::{choose, ended};
use crate::design::Design;
use crate::drive::World;
use crate::envelope::{Margin, holds};
use crate::error::ExperimentError;
use crate::report::{Next, Planned, Refused, Run};
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

/// Drives what is planned; returns the case with its log, that log and what the car left of the envelope.
fn added(
    grown: &Case,
    case: &Case,
    world: &World<'_>,
    planned: &Planned,
    number: usize,
    settings: &Settings,
) -> Result<(Case, Table, Vec<Margin>), ExperimentError> {
    let logged = drive(world, &Design::named(&planned.design), case, number, settings)?;
    Ok((join(grown, number, logged.drive)?, logged.table, logged.margins))
}

/// Diagnoses a case, drives what tells most of what that leaves, and goes on until one hypothesis is likely enough, nothing
/// more is to be learned or the runs are spent; `tell` hears of each run. A run whose log is refused is told of, and another
/// manoeuvre driven; what else fails after the first run ends the loop. Returns the state at the end, the logs that were added
/// and the last diagnosis.
///
/// # Errors
/// If no manoeuvre holds the envelope to begin with, or the first drive comes to nothing.
pub fn run(
    case: &Case,
    world: &World<'_>,
    settings: &Settings,
    tell: &dyn Fn(&Run),
) -> Result<(Next, Vec<Table>, Diagnosis), ExperimentError> {
    let options = Options { quick: settings.quick, without: Vec::new() };
    let mut grown = case.clone();
    let (mut runs, mut refused, mut logs): (Vec<Run>, Vec<Refused>, Vec<Table>) = Default::default();
    let mut allowed = settings.clone();
    let mut found: (Diagnosis, Vec<Standing>) = diagnose_leaving(&grown, &options);
    loop {
        let driven = runs.len() + refused.len();
        allowed.seed = settings.seed + driven as u64;
        let mut next = match choose(&grown, &found.0, &found.1, &allowed) {
            Err(error) if driven > 0 => ended(&found.0, &found.1, settings.seed, &error),
            chosen => chosen?,
        };
        next.seed = settings.seed;
        if driven == MOST_RUNS && next.ended.is_none() {
            next.ended = Some(format!("{MOST_RUNS} runs were driven"));
        }
        let (Some(planned), None) = (&next.planned, &next.ended) else {
            return Ok((Next { runs, refused, ..next }, logs, found.0));
        };
        let number = driven + 1;
        let (table, margins) = match added(&grown, case, world, planned, number, settings) {
            Ok((more, table, margins)) => {
                grown = more;
                (table, margins)
            }
            Err(ExperimentError::Log { source, .. }) => {
                allowed.without.push(planned.begun().to_owned());
                let (from, design) = (planned.from.clone(), planned.design.clone());
                refused.push(Refused { run: number, from, design, why: source.to_string() });
                continue;
            }
            Err(error) if driven > 0 => {
                return Ok((Next { runs, refused, ended: Some(error.to_string()), ..next }, logs, found.0));
            }
            Err(error) => return Err(error),
        };
        found = diagnose_leaving(&grown, &options);
        let first = &found.1[0];
        let run = Run {
            run: number,
            file: file(number),
            from: planned.from.clone(),
            design: planned.design.clone(),
            nats: planned.nats,
            left_envelope: !holds(&margins),
            margins,
            effects: first.effects.clone(),
            probability: first.probability,
            p_unknown: found.0.p_unknown,
        };
        tell(&run);
        runs.push(run);
        logs.push(table);
    }
}
