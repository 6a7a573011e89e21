//! A diagnosis as a message of the bus.

use ds_diagnosis::schema::{Cell, Diagnosis as Found, Finding};
use ds_space::{InstanceId, SimTime};
use ds_topic::{DiagnosedEffect, Diagnosis, Envelope, GapCell, Header, SCHEMA_VERSION, Slot, Topic};
use ds_wire::Body;
use ds_wire::diagnosis::{MAX_CELLS, MAX_EFFECTS, MAX_REFERENCE_BYTES};

/// What a window was compared with.
#[derive(Debug, Clone, Default)]
pub struct Against {
    /// Name of the reference stream; empty for the drive's own log.
    pub reference: String,
    /// How far the drive is from it, by channel.
    pub differences: Vec<(String, f64)>,
}

/// Returns a diagnosis of a window as the body of a message.
#[must_use]
pub fn body(found: &Found, from: f64, to: f64, against: Against) -> Diagnosis {
    let mut reference = against.reference;
    while reference.len() > MAX_REFERENCE_BYTES {
        reference.pop();
    }
    Diagnosis {
        window: (SimTime::from_secs(from), SimTime::from_secs(to)),
        reference,
        verdict: found.verdict,
        p_none: found.p_none.clamp(0.0, 1.0),
        p_unknown: found.p_unknown.clamp(0.0, 1.0),
        effects: effects(found).into_iter().take(MAX_EFFECTS).collect(),
        cells: found.cells.iter().filter(|cell| cell.effect_size.is_finite()).map(cell).take(MAX_CELLS).collect(),
        differences: against.differences,
    }
}

/// Returns the effects that were considered.
#[must_use]
pub fn effects(found: &Found) -> Vec<DiagnosedEffect> {
    let finite = |value: f64| value.is_finite().then_some(value);
    let effect = |finding: &Finding| {
        let fitted = !(finding.unit.is_empty() && finding.params.is_empty());
        DiagnosedEffect {
            id: finding.id.clone(),
            probability: finding.probability.clamp(0.0, 1.0),
            value: finite(finding.value).filter(|_| fitted),
            unit: finding.unit.clone(),
            interval90: if fitted { finding.interval90.map(finite) } else { [None, None] },
            chosen: found.chosen.contains(&finding.id),
        }
    };
    found.effects.iter().map(effect).collect()
}

/// Returns a cell with its bins; the number of its drive is left to whoever shows several.
#[must_use]
pub fn cell(cell: &Cell) -> GapCell {
    let regime = &cell.regime;
    let tile = regime.tile.map(|[row, column]| format!("{row},{column}"));
    let axes = [
        ("class", regime.class.clone()),
        ("distance", regime.distance.clone()),
        ("lateral", regime.lateral.clone()),
        ("pedal", regime.pedal.clone()),
        ("speed", regime.speed.clone()),
        ("steering", regime.steering.clone()),
        ("tile", tile),
    ];
    GapCell {
        channel: cell.channel.clone(),
        bins: axes.into_iter().filter_map(|(axis, bin)| Some((axis.to_owned(), bin?))).collect(),
        effect_size: cell.effect_size.max(0.0),
        q_value: cell.q_value.map(|q| q.clamp(0.0, 1.0)),
    }
}

/// Returns the message of a diagnosis; `at` is the header of the state at the end of its window.
#[must_use]
pub fn envelope(at: &Header, publisher: &InstanceId, sequence: u64, body: &Diagnosis) -> Envelope {
    let header = Header {
        epoch: 0,
        sequence,
        publisher: publisher.clone(),
        schema_version: SCHEMA_VERSION,
        slot: Slot::new(Topic::Diagnosis, at.tick.0),
        content: body.content(),
        ..at.clone()
    };
    Envelope { header, body: body.to_bytes() }
}

#[cfg(test)]
mod tests {
    use ds_diagnosis::Verdict;

    use super::*;

    #[test]
    fn what_has_no_finite_value_is_absent_on_the_bus() {
        let finding = |id: &str, value: f64, unit: &str| Finding {
            id: id.to_owned(),
            probability: 0.3,
            value,
            unit: unit.to_owned(),
            interval90: [0.1, f64::INFINITY],
            group: Vec::new(),
            heldout_gain: None,
            evidence_gain: 0.0,
            params: std::collections::BTreeMap::new(),
        };
        let nowhere = ds_diagnosis::schema::Regime { drive: 0, ..ds_diagnosis::schema::Regime::default() };
        let regime = ds_diagnosis::schema::Regime { speed: Some("high".to_owned()), tile: Some([1, 2]), ..nowhere };
        let cell = Cell { channel: "v".to_owned(), regime, effect_size: 2.0, q_value: Some(1.5), t: Vec::new() };
        let found = Found {
            verdict: Verdict::Single,
            effects: vec![finding("steer_rate", f64::INFINITY, "rad/s"), finding("mu", 0.0, "")],
            p_none: 0.4,
            p_unknown: -1e-18,
            chosen: vec!["steer_rate".to_owned()],
            cells: vec![cell],
            floor_source: "self".to_owned(),
            ..Found::blank("e")
        };
        let against = Against { reference: "x".repeat(300), differences: Vec::new() };
        let body = body(&found, 1.0, 9.0, against);
        assert_eq!((body.effects[0].value, body.effects[0].interval90), (None, [Some(0.1), None]));
        assert_eq!((body.effects[1].value, body.effects[1].interval90), (None, [None, None]));
        assert_eq!(body.effects.iter().map(|effect| effect.chosen).collect::<Vec<_>>(), [true, false]);
        let bins = [("speed".to_owned(), "high".to_owned()), ("tile".to_owned(), "1,2".to_owned())];
        assert_eq!((body.cells[0].bins.as_slice(), body.cells[0].q_value), (bins.as_slice(), Some(1.0)));
        assert_eq!(Diagnosis::from_bytes(&body.to_bytes()), Ok(body));
    }
}
