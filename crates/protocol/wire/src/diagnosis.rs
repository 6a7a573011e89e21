//! Topic `diagnosis`: verdict, effects with their intervals, cells of the gap, differences to a reference stream.

use ds_effect::Verdict;
use ds_space::SimTime;
use ds_topic::{DiagnosedEffect, Diagnosis, GapCell};

use crate::error::FieldError;
use crate::field::{choice, enumeration, extent, list, number, perhaps, text};
use crate::v1;

/// The most effects.
pub const MAX_EFFECTS: usize = 256;
/// The most cells.
pub const MAX_CELLS: usize = 128;
/// The most bins of a cell.
pub const MAX_BINS: usize = 8;
/// The most channels that are compared with a reference stream.
pub const MAX_DIFFERENCES: usize = 64;
/// The longest id or name, in bytes.
const MAX_NAME_BYTES: usize = 64;
/// The longest unit, in bytes.
const MAX_UNIT_BYTES: usize = 32;
/// The longest name of a reference stream, in bytes.
pub const MAX_REFERENCE_BYTES: usize = 256;

enumeration!(v1::GapVerdict, Verdict, { None = None, Single = Single, Multiple = Multiple, Unknown = Unknown });

/// Takes a name that is not empty.
fn name(field: &str, value: String) -> Result<String, FieldError> {
    if value.is_empty() {
        return Err(FieldError::new(field, "is empty"));
    }
    text(field, value, MAX_NAME_BYTES)
}

/// Takes a probability.
fn probability(field: &str, value: Option<f64>) -> Result<f64, FieldError> {
    match number(field, value)? {
        value if (0.0..=1.0).contains(&value) => Ok(value),
        value => Err(FieldError::new(field, format!("is {value}, must be 0 to 1"))),
    }
}

impl From<&DiagnosedEffect> for v1::DiagnosedEffect {
    fn from(value: &DiagnosedEffect) -> Self {
        let [low, high] = value.interval90;
        Self {
            id: value.id.clone(),
            probability: Some(value.probability),
            value: value.value,
            unit: value.unit.clone(),
            low,
            high,
            chosen: value.chosen,
        }
    }
}

impl TryFrom<v1::DiagnosedEffect> for DiagnosedEffect {
    type Error = FieldError;
    fn try_from(message: v1::DiagnosedEffect) -> Result<Self, FieldError> {
        Ok(Self {
            id: name("id", message.id)?,
            probability: probability("probability", message.probability)?,
            value: perhaps("value", message.value)?,
            unit: text("unit", message.unit, MAX_UNIT_BYTES)?,
            interval90: [perhaps("low", message.low)?, perhaps("high", message.high)?],
            chosen: message.chosen,
        })
    }
}

impl From<&GapCell> for v1::GapCell {
    fn from(value: &GapCell) -> Self {
        let bin = |(axis, bin): &(String, String)| v1::RegimeBin { axis: axis.clone(), bin: bin.clone() };
        Self {
            channel: value.channel.clone(),
            bins: value.bins.iter().map(bin).collect(),
            effect_size: Some(value.effect_size),
            q_value: value.q_value,
        }
    }
}

impl TryFrom<v1::GapCell> for GapCell {
    type Error = FieldError;
    fn try_from(message: v1::GapCell) -> Result<Self, FieldError> {
        if message.bins.len() > MAX_BINS {
            let problem = format!("has {} elements, the limit is {MAX_BINS}", message.bins.len());
            return Err(FieldError::new("bins", problem));
        }
        let mut bins: Vec<(String, String)> = Vec::new();
        for (index, entry) in message.bins.into_iter().enumerate() {
            let place = |error: FieldError| error.within("bins", index);
            let axis = name("axis", entry.axis).map_err(place)?;
            if bins.last().is_some_and(|(before, _)| *before >= axis) {
                return Err(place(FieldError::new("axis", format!("is {axis:?}, which is out of order"))));
            }
            bins.push((axis, name("bin", entry.bin).map_err(place)?));
        }
        Ok(Self {
            channel: name("channel", message.channel)?,
            bins,
            effect_size: extent("effect_size", message.effect_size)?,
            q_value: message.q_value.map(|q| probability("q_value", Some(q))).transpose()?,
        })
    }
}

/// One difference, on its way.
struct Difference(String, f64);

impl TryFrom<v1::ChannelDifference> for Difference {
    type Error = FieldError;
    fn try_from(message: v1::ChannelDifference) -> Result<Self, FieldError> {
        Ok(Self(name("channel", message.channel)?, extent("rms", message.rms)?))
    }
}

impl From<&Diagnosis> for v1::Diagnosis {
    fn from(value: &Diagnosis) -> Self {
        let difference =
            |(channel, rms): &(String, f64)| v1::ChannelDifference { channel: channel.clone(), rms: Some(*rms) };
        Self {
            header: None,
            from_ns: value.window.0.0,
            to_ns: value.window.1.0,
            reference: value.reference.clone(),
            verdict: v1::GapVerdict::from(value.verdict).into(),
            p_none: Some(value.p_none),
            p_unknown: Some(value.p_unknown),
            effects: value.effects.iter().map(Into::into).collect(),
            cells: value.cells.iter().map(Into::into).collect(),
            differences: value.differences.iter().map(difference).collect(),
        }
    }
}

impl TryFrom<v1::Diagnosis> for Diagnosis {
    type Error = FieldError;
    fn try_from(message: v1::Diagnosis) -> Result<Self, FieldError> {
        let (from, to) = (message.from_ns, message.to_ns);
        if to < from {
            return Err(FieldError::new("to_ns", format!("is {to}, before from_ns {from}")));
        }
        let differences: Vec<Difference> = list("differences", message.differences, MAX_DIFFERENCES)?;
        Ok(Self {
            window: (SimTime(from), SimTime(to)),
            reference: text("reference", message.reference, MAX_REFERENCE_BYTES)?,
            verdict: choice::<v1::GapVerdict, _>("verdict", message.verdict)?,
            p_none: probability("p_none", message.p_none)?,
            p_unknown: probability("p_unknown", message.p_unknown)?,
            effects: list("effects", message.effects, MAX_EFFECTS)?,
            cells: list("cells", message.cells, MAX_CELLS)?,
            differences: differences.into_iter().map(|Difference(channel, rms)| (channel, rms)).collect(),
        })
    }
}
