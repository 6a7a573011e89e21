//! Reads a table of numbers in any of the usual layouts, keeping only the columns that the mapping names.

use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::Path;

use ds_diagnosis::CaseError;

use crate::error::LogError;
use crate::mapping::{Column, Decimal, Header, Layout};

/// Most rows of a log: 5 h at 200 Hz.
const MAX_ROWS: usize = 3_600_000;

/// The wanted columns of a file; an absent cell is NaN.
pub(crate) struct Sheet {
    /// Name of the file.
    pub file: String,
    names: Vec<String>,
    wanted: Vec<(Column, Option<usize>)>,
    columns: Vec<Vec<f64>>,
}

impl Sheet {
    /// Reads a file.
    ///
    /// # Errors
    /// If it cannot be read, is ragged or too long, or holds a cell in a wanted column that is no number.
    pub(crate) fn read(path: &Path, layout: &Layout, wanted: &[Column]) -> Result<Self, LogError> {
        let failed = |source| CaseError::Read { path: path.to_path_buf(), source };
        let file = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let mut sheet = Self { file, names: Vec::new(), wanted: Vec::new(), columns: Vec::new() };
        let (mut width, mut skip) = (None, layout.skip);
        for (number, line) in open(path)?.split(b'\n').enumerate() {
            let line = text_of(&line.map_err(failed)?, number + 1, &sheet.file)?;
            let mut line = line.as_str();
            let comment = layout.comment.as_deref().filter(|mark| line.starts_with(mark));
            if let Some(mark) = comment {
                if layout.header != Header::Commented || width.is_some() {
                    continue;
                }
                line = &line[mark.len()..];
            }
            if line.trim().is_empty() {
                continue;
            }
            if skip > 0 && (width.is_some() || layout.header == Header::None) {
                skip -= 1;
                continue;
            }
            let cells = split(line, &layout.delimiter);
            let Some(columns) = width else {
                width = Some(cells.len());
                let named = layout.header != Header::None;
                sheet.name(
                    if named { cells.iter().map(|c| (*c).to_owned()).collect() } else { Vec::new() },
                    wanted,
                    cells.len(),
                );
                if !named {
                    sheet.push(&cells, number + 1, layout.decimal)?;
                }
                continue;
            };
            if cells.len() != columns {
                return Err(LogError::Ragged { line: number + 1, cells: cells.len(), columns, file: sheet.file });
            }
            sheet.push(&cells, number + 1, layout.decimal)?;
            if sheet.rows() > MAX_ROWS {
                return Err(CaseError::TooLarge { what: "rows", limit: MAX_ROWS, file: sheet.file }.into());
            }
        }
        Ok(sheet)
    }

    fn name(&mut self, names: Vec<String>, wanted: &[Column], width: usize) {
        let place = |column: &Column| match column {
            Column::Number(number) => number.checked_sub(1).filter(|n| *n < width),
            Column::Name(name) => names.iter().position(|n| n == name),
        };
        self.wanted = wanted.iter().map(|c| (c.clone(), place(c))).collect();
        self.columns = vec![Vec::new(); wanted.len()];
        self.names = names;
    }

    fn push(&mut self, cells: &[&str], line: usize, decimal: Decimal) -> Result<(), LogError> {
        for ((_, place), column) in self.wanted.iter().zip(&mut self.columns) {
            let Some(place) = *place else { continue };
            let text = cells[place];
            column.push(number(text, decimal).ok_or_else(|| LogError::NotANumber {
                line,
                column: place + 1,
                text: text.chars().take(24).collect(),
                file: self.file.clone(),
            })?);
        }
        Ok(())
    }

    /// Returns the number of rows.
    pub(crate) fn rows(&self) -> usize {
        self.columns.iter().map(Vec::len).max().unwrap_or(0)
    }

    /// Returns a wanted column; `None` if the file does not have it or it is wholly empty.
    pub(crate) fn column(&self, column: &Column) -> Option<&[f64]> {
        let at = self.wanted.iter().position(|(c, place)| c == column && place.is_some())?;
        let cells = self.columns[at].as_slice();
        cells.iter().any(|v| v.is_finite()).then_some(cells)
    }

    /// Returns a wanted column that must be there.
    ///
    /// # Errors
    /// If it is not.
    pub(crate) fn required(&self, column: &Column) -> Result<&[f64], LogError> {
        self.column(column).ok_or_else(|| LogError::NoColumn {
            column: column.to_string(),
            found: self.names.clone(),
            file: self.file.clone(),
        })
    }
}

impl std::fmt::Display for Column {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Number(number) => write!(out, "number {number}"),
            Self::Name(name) => out.write_str(name),
        }
    }
}

/// Opens a text file.
pub(crate) fn open(path: &Path) -> Result<BufReader<File>, LogError> {
    let failed = |source| CaseError::Read { path: path.to_path_buf(), source };
    Ok(BufReader::new(File::open(path).map_err(failed)?))
}

/// Returns a line as text without the marks at its ends; what is no UTF-8, such as a sign for degrees of another code, becomes
/// a sign for that.
///
/// # Errors
/// If it holds a zero byte, as UTF-16 and files that are no text do.
pub(crate) fn text_of(line: &[u8], number: usize, file: &str) -> Result<String, LogError> {
    if line.contains(&0) {
        let why = format!("line {number} holds a zero byte: save it as text in UTF-8");
        return Err(LogError::NoTable { why, file: file.to_owned() });
    }
    let text = String::from_utf8_lossy(line);
    Ok(text.trim_start_matches('\u{feff}').trim_end_matches('\r').to_owned())
}

/// Reads a cell; an absent one is not a number. `None` where it is neither.
pub(crate) fn number(cell: &str, decimal: Decimal) -> Option<f64> {
    if cell.is_empty() || ["nan", "null", "na", "none"].contains(&cell.to_ascii_lowercase().as_str()) {
        return Some(f64::NAN);
    }
    let value = match decimal {
        Decimal::Comma if cell.contains('.') => return None,
        Decimal::Comma => cell.replace(',', ".").parse(),
        Decimal::Point => cell.parse(),
    };
    value.ok().filter(|v: &f64| v.is_finite())
}

/// Splits a line into cells without the marks and blanks around them; what stands in quotation marks is one cell.
pub(crate) fn split<'a>(line: &'a str, delimiter: &str) -> Vec<&'a str> {
    let bare = |cell: &'a str| cell.trim().trim_matches('"').trim();
    let mark = match delimiter {
        "space" => return line.split_whitespace().collect(),
        "tab" => "\t",
        other => other,
    };
    let mut quoted = false;
    let parts = |letter: char| {
        quoted ^= letter == '"';
        !quoted && mark.starts_with(letter)
    };
    line.split(parts).map(bare).collect()
}
