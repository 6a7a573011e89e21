//! `gap explain`: finished diagnoses again as text, as pages and for the rerun viewer.
//!
//! `gap diagnose` notes beside each diagnosis which case it was made from, so that the residuals can be drawn without
//! being told where the logs are.

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use ds_cases::finished::{diagnoses, noted_case};
use ds_cases::message;
use ds_diagnosis::meta::Kind;
use ds_diagnosis::schema::Cell;
use ds_diagnosis::{Diagnosis, json};
use ds_dynamics::case::Case;
use ds_dynamics::traces::{Moment, Series, Traces, traces};
use ds_launch::onlooker as viewer;
use ds_process::terminal::answer;
use ds_record::viewing::{Along, Curve, Explained};
use ds_topic::GapCell;

use crate::cli::ExplainArgs;
use crate::{PAGE, put};

/// Drives that are drawn for the viewer.
const DRIVES: usize = 8;

/// Runs the command.
///
/// # Errors
/// If there is no diagnosis, or a file cannot be read or written.
pub(crate) fn run(args: &ExplainArgs) -> Result<()> {
    let found = diagnoses(&args.diagnosis)?;
    let one = found.len() == 1;
    let given = [("-o", args.out.is_some()), ("--case", args.case.is_some()), ("--rerun", args.rerun.is_some())];
    for (flag, given) in given {
        ensure!(one || !given, "{flag} is for one diagnosis, {} holds {}", args.diagnosis.display(), found.len());
    }
    let mut made = Vec::new();
    for path in &found {
        let diagnosis: Diagnosis = json::read(path)?;
        let case = args.case.clone().or_else(|| noted(path));
        let out = args.out.clone().unwrap_or_else(|| path.with_file_name(PAGE));
        put(&out, &ds_diagnosis_page::page(&diagnosis, case.as_deref()))?;
        answer(&ds_diagnosis_page::text(&diagnosis));
        answer(&format!("page: {}", out.display()));
        if let Some(rrd) = &args.rerun {
            viewer::hand(["diagnosis".into(), rrd.into()], &drawn(&diagnosis, case.as_deref())?)?;
            answer(&format!("rerun {}", rrd.display()));
        }
        made.push((format!("{}/{PAGE}", ds_cases::folder::name(path.parent().unwrap_or(path))), diagnosis));
    }
    if !one {
        let index = args.diagnosis.join("index.html");
        put(&index, &ds_diagnosis_page::index(&made))?;
        answer(&format!("all of them: {}", index.display()));
    }
    Ok(())
}

/// Returns the case that a diagnosis was made from, if it was noted and is there.
fn noted(diagnosis: &Path) -> Option<PathBuf> {
    let case = noted_case(diagnosis)?;
    if case.is_dir() {
        return Some(case);
    }
    answer(&format!("the case is not at {} any more: --case adds its residuals", case.display()));
    None
}

/// Returns what the viewer shows of a diagnosis; without its case there are no residuals.
fn drawn(diagnosis: &Diagnosis, case: Option<&Path>) -> Result<Explained> {
    let drives = match case {
        Some(folder) if Kind::of(folder) == Kind::Vehicle => along(diagnosis, &Case::read(folder)?),
        _ => Vec::new(),
    };
    let summary = ds_diagnosis_page::text(diagnosis).lines().map(|line| format!("{line}  \n")).collect();
    let cells: Vec<GapCell> = diagnosis.cells.iter().map(numbered).collect();
    Ok(Explained { drives, ..Explained::new(&diagnosis.case, summary, &message::effects(diagnosis), &cells) })
}

/// Returns a cell with its drive.
fn numbered(cell: &Cell) -> GapCell {
    let mut drawn = message::cell(cell);
    drawn.bins.insert(0, ("drive".to_owned(), cell.regime.drive.to_string()));
    drawn
}

/// Returns the gap along the drives of a case.
fn along(diagnosis: &Diagnosis, case: &Case) -> Vec<Along> {
    let moment = |m: &Moment| [m.secs, m.before, m.after, m.floor];
    let curve = |s: &Series| Curve::new(s.name.clone(), s.moments.iter().map(moment));
    let drawn = |t: Traces| Along { drive: t.drive, path: t.path, curves: t.series.iter().map(curve).collect() };
    let drives = (0..case.drives.len()).take(DRIVES).map(|drive| traces(case, &diagnosis.corrected_model, drive));
    drives.filter(|traces| !traces.series.is_empty()).map(drawn).collect()
}
