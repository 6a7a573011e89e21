//! How a text file is laid out, told by its first lines: what parts its cells, its decimal sign, its line of names, and
//! lines below that one which hold no numbers.

use std::io::BufRead as _;
use std::path::Path;

use ds_diagnosis::CaseError;

use super::names::is_unit;
use crate::error::LogError;
use crate::mapping::{Column, Decimal, Header, Layout, LogFormat};
use crate::raw::{number, open, split, text_of};

/// Lines that are looked at.
const LINES: usize = 200;
/// Signs before lines that are comments.
const COMMENTS: [&str; 3] = ["#", "%", "//"];
/// What may part cells, the likeliest first: a comma may also be a decimal sign, a blank part of a name.
const DELIMITERS: [&str; 4] = [";", "tab", ",", "space"];

/// The layout of a text file.
pub(super) struct Form {
    /// As a mapping says it.
    pub layout: Layout,
    /// The columns.
    pub columns: Vec<Head>,
}

/// The head of a column.
pub(super) struct Head {
    /// Its name.
    pub name: String,
    /// By what a mapping names it: its number where another column has its name.
    pub column: Column,
    /// What stands below its name where that line holds no numbers.
    pub below: String,
    /// A cell that is no number, if one of the first is so.
    pub words: Option<String>,
}

impl std::fmt::Display for Head {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.column {
            Column::Number(number) => write!(out, "{:?} (column {number})", self.name),
            Column::Name(_) => write!(out, "{:?}", self.name),
        }
    }
}

impl Form {
    /// Tells the layout of a file by its first lines.
    ///
    /// # Errors
    /// If it cannot be read, or is no table with a line of names.
    pub(super) fn of(path: &Path) -> Result<Self, LogError> {
        let file = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let no_table = |why: &str| LogError::NoTable { why: why.to_owned(), file: file.clone() };
        let mut lines = Vec::new();
        for line in open(path)?.split(b'\n').take(LINES) {
            let line = line.map_err(|source| CaseError::Read { path: path.to_path_buf(), source })?;
            lines.push(text_of(&line, lines.len() + 1, &file)?);
        }
        lines.retain(|line| !line.trim().is_empty());
        let comment = lines.first().and_then(|line| COMMENTS.into_iter().find(|mark| line.starts_with(mark)));
        let told: Option<&str> =
            lines.first().zip(comment).map(|(line, mark)| line.trim_start_matches(mark).trim_start_matches(' '));
        let rest: Vec<&str> =
            lines.iter().map(String::as_str).filter(|l| comment.is_none_or(|c| !l.starts_with(c))).collect();
        let [first, second, ..] = rest[..] else { return Err(no_table("it has fewer than two lines of cells")) };
        let delimiter = DELIMITERS.into_iter().find(|delimiter| is_even(&rest, delimiter));
        let delimiter = delimiter.ok_or_else(|| {
            no_table("neither semicolon, tab, comma nor blank parts all of its lines into as many cells")
        })?;
        let cells = |line: &str| split(line, delimiter).iter().map(|cell| (*cell).to_owned()).collect::<Vec<String>>();
        let decimal = decimal(&rest, delimiter);
        let numbers =
            |line: &str| cells(line).iter().filter(|cell| number(cell, decimal).is_some_and(f64::is_finite)).count();
        let named = |line: &str| numbers(line) * 2 <= cells(line).iter().filter(|cell| !cell.is_empty()).count();
        let (header, names) = match told.filter(|told| !named(first) && cells(told).len() == cells(first).len()) {
            Some(told) => (Header::Commented, cells(told)),
            None if named(first) => (Header::First, cells(first)),
            None => {
                return Err(no_table(
                    "its first line holds numbers and no names: write a mapping by the columns' numbers with log.header = \"none\"",
                ));
            }
        };
        let data = if header == Header::First { &rest[1..] } else { &rest[..] };
        let skip = data.iter().take_while(|line| numbers(line) == 0).count();
        let below = if header == Header::First && skip > 0 { cells(second) } else { Vec::new() };
        let below =
            if below.iter().any(|cell| is_unit(cell.trim_matches(['[', ']', '(', ')']))) { below } else { Vec::new() };
        let wrong = |at: usize| {
            let found = data.iter().skip(skip).filter_map(|line| cells(line).get(at).cloned());
            found.into_iter().find(|cell| number(cell, decimal).is_none())
        };
        let head = |(at, name): (usize, &String)| Head {
            column: if names.iter().filter(|other| *other == name).count() == 1 && !name.is_empty() {
                Column::Name(name.clone())
            } else {
                Column::Number(at + 1)
            },
            name: name.clone(),
            below: below.get(at).cloned().unwrap_or_default(),
            words: wrong(at),
        };
        let columns = names.iter().enumerate().map(head).collect();
        let layout = Layout {
            name: path.file_stem().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default(),
            format: LogFormat::Csv,
            delimiter: delimiter.to_owned(),
            decimal,
            comment: comment.map(str::to_owned),
            header,
            skip,
            piece_secs: None,
            least_speed_mps: 0.0,
        };
        Ok(Self { layout, columns })
    }
}

/// Tells whether a sign parts all lines into as many cells, two or more.
fn is_even(lines: &[&str], delimiter: &str) -> bool {
    let counts: Vec<usize> = lines.iter().map(|line| split(line, delimiter).len()).collect();
    // the last line looked at may be broken off
    counts[0] > 1 && counts.iter().all(|count| *count == counts[0])
}

/// Tells the decimal sign: a comma where a cell has one between digits that no point is in.
fn decimal(lines: &[&str], delimiter: &str) -> Decimal {
    let comma = |cell: &&str| cell.contains(',') && !cell.contains('.') && number(cell, Decimal::Comma).is_some();
    let any = lines.iter().skip(1).any(|line| split(line, delimiter).iter().any(comma));
    if any { Decimal::Comma } else { Decimal::Point }
}
