//! Topic `score`: named sub-metrics.

use ds_topic::Score;

use crate::error::FieldError;
use crate::field::{perhaps, text};
use crate::v1;

/// The most sub-metrics.
pub const MAX_VALUES: usize = 256;
/// The longest name, in bytes.
pub const MAX_NAME_BYTES: usize = 64;

impl From<&Score> for v1::Score {
    fn from(value: &Score) -> Self {
        let entry = |(name, value): &(String, Option<f64>)| v1::ScoreValue { name: name.clone(), value: *value };
        Self { header: None, values: value.values.iter().map(entry).collect() }
    }
}

impl TryFrom<v1::Score> for Score {
    type Error = FieldError;
    fn try_from(message: v1::Score) -> Result<Self, FieldError> {
        let mut values: Vec<(String, Option<f64>)> = Vec::new();
        for (index, entry) in message.values.into_iter().enumerate() {
            let place = |error: FieldError| error.within("values", index);
            let name = text("name", entry.name, MAX_NAME_BYTES).map_err(place)?;
            if values.last().map_or("", |(before, _)| before) >= name.as_str() {
                return Err(place(FieldError::new("name", format!("is {name:?}, which is empty or out of order"))));
            }
            let value = perhaps("value", entry.value).map_err(place)?;
            if let Some(value) = value.filter(|value| !(0.0..=1.0).contains(value)) {
                return Err(place(FieldError::new("value", format!("is {value}, must be 0 to 1"))));
            }
            values.push((name, value));
        }
        Ok(Self { values })
    }
}
