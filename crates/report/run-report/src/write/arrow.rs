//! Tables as Arrow IPC files: one record batch, uncompressed, utf8, uint64 and float64 columns.
//!
//! What does not apply is null. The schema's metadata says what the rows are and how the scores are defined.

use std::sync::Arc;

use arrow_array::{ArrayRef, Float64Array, RecordBatch, StringArray, UInt64Array};
use arrow_ipc::writer::FileWriter;
use arrow_schema::{ArrowError, DataType, Field, Schema};

use crate::aggregate::{Aggregate, HEADLINE, INTERVALS, WEIGHTING};
use crate::results::Results;
use crate::write::columns::{self, Table, Values};

/// Returns one row per episode of all runs.
///
/// # Errors
/// If Arrow refuses the table, as it does with more than 2 GiB of text in a column.
pub fn episodes(runs: &[Results]) -> Result<Vec<u8>, ArrowError> {
    table(&columns::episodes(runs), &[("rows", "one per episode; scores are 0 to 1, null is not applicable")])
}

/// Returns one row per group and metric.
///
/// # Errors
/// As [`episodes`].
pub fn aggregate(aggregate: &Aggregate) -> Result<Vec<u8>, ArrowError> {
    let metadata = [
        ("rows", "one per group and metric; scores are 0 to 1, null is not applicable"),
        ("weighting", WEIGHTING),
        ("headline", HEADLINE),
        ("intervals", INTERVALS),
    ];
    table(&columns::aggregate(aggregate), &metadata)
}

/// Returns any table as the bytes of a file.
///
/// # Errors
/// As [`episodes`].
pub fn table(table: &Table, metadata: &[(&str, &str)]) -> Result<Vec<u8>, ArrowError> {
    let (mut fields, mut arrays): (Vec<Field>, Vec<ArrayRef>) = (Vec::new(), Vec::new());
    for column in &table.columns {
        fits(&column.values)?;
        let (kind, array): (DataType, ArrayRef) = match &column.values {
            Values::Text(values) => (DataType::Utf8, Arc::new(StringArray::from_iter_values(values))),
            Values::Count(values) => (DataType::UInt64, Arc::new(UInt64Array::from(values.clone()))),
            Values::Number(values) => (DataType::Float64, Arc::new(Float64Array::from(values.clone()))),
        };
        fields.push(Field::new(&column.name, kind, true));
        arrays.push(array);
    }
    let metadata = metadata.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect();
    let schema = Arc::new(Schema::new(fields).with_metadata(metadata));
    let batch = RecordBatch::try_new(Arc::clone(&schema), arrays)?;
    let mut writer = FileWriter::try_new(Vec::new(), &schema)?;
    writer.write(&batch)?;
    writer.into_inner()
}

/// Offsets of utf8 columns are 32 bits wide.
fn fits(values: &Values) -> Result<(), ArrowError> {
    let Values::Text(texts) = values else { return Ok(()) };
    let bytes: usize = texts.iter().map(String::len).sum();
    match i32::try_from(bytes) {
        Ok(_) => Ok(()),
        Err(_) => Err(ArrowError::InvalidArgumentError(format!("{bytes} bytes of text in a column"))),
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use arrow_array::Array;
    use arrow_array::cast::AsArray;
    use arrow_array::types::{Float64Type, UInt64Type};
    use arrow_ipc::reader::FileReader;

    use super::*;
    use crate::sample;

    fn read(bytes: Vec<u8>) -> RecordBatch {
        let mut reader = FileReader::try_new(Cursor::new(bytes), None).expect("an Arrow file");
        let batch = reader.next().expect("one batch").expect("a sound batch");
        assert!(reader.next().is_none(), "more than one batch");
        batch
    }

    fn check(table: &Table, batch: &RecordBatch) {
        assert_eq!((batch.num_rows(), batch.num_columns()), (table.rows(), table.columns.len()));
        for column in &table.columns {
            let array = batch.column_by_name(&column.name).unwrap_or_else(|| panic!("no column {}", column.name));
            for row in 0..table.rows() {
                let known = array.is_valid(row);
                match &column.values {
                    Values::Text(values) => assert_eq!(array.as_string::<i32>().value(row), values[row]),
                    Values::Count(values) => {
                        assert_eq!(known.then(|| array.as_primitive::<UInt64Type>().value(row)), values[row]);
                    }
                    Values::Number(values) => {
                        assert_eq!(known.then(|| array.as_primitive::<Float64Type>().value(row)), values[row]);
                    }
                }
            }
        }
    }

    #[test]
    fn tables_come_back() {
        let (runs, report) = (sample::runs(), sample::report());
        check(&columns::episodes(&runs), &read(episodes(&runs).expect("a table")));
        let batch = read(aggregate(&report.headline).expect("a table"));
        check(&columns::aggregate(&report.headline), &batch);
        assert_eq!(batch.schema().metadata()["weighting"], WEIGHTING);
    }

    #[test]
    fn no_episodes_are_a_file_too() {
        let batch = read(episodes(&[]).expect("a table"));
        assert!(batch.num_rows() == 0 && batch.num_columns() > 20);
    }
}
