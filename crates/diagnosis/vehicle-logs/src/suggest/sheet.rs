//! A text file → the mapping that the names of its columns, the units in its header and its data suggest.

use std::path::Path;

use super::form::{Form, Head};
use super::names::{Meaning, Told, told};
use super::units::{decide, range};
use super::{Draft, Heading, Suggestion, WHEELBASE_M};
use crate::channel::{CHANNELS, seconds};
use crate::check::{STEERING_RATIO, wheelbase_m};
use crate::error::LogError;
use crate::mapping::{Column, Decimal, DriveFile, Header, Layout, Mapping};
use crate::raw::Sheet;
use crate::record::Record;
use crate::stamps::{USUAL_STEP_SECS, growing};

/// Longest stretch on which units are told, s.
const LOOKED_AT_SECS: f64 = 600.0;
/// How a heading is read that counts as a compass does, x being east.
const COMPASS: [&str; 2] = ["negate = true, offset = -1.570796", "unit = \"deg\", negate = true, offset = -1.570796"];
/// Words of a heading that may be a compass's.
const OF_COMPASS: [&str; 5] = ["heading", "course", "azimuth", "bearing", "psi"];
/// Words that tell the wheels of a vehicle apart.
const SIDES: [&str; 11] = ["fl", "fr", "rl", "rr", "lf", "rf", "lr", "front", "rear", "left", "right"];
/// Words of the wheel in the driver's hands.
const HANDS: [&str; 5] = ["wheel", "handwheel", "hand", "swa", "sas"];
/// Correlation with which a turn must go with the steering to tell what it is.
const STEERED: f64 = 0.9;
/// What the wheelbase may be of the usual one: from a small car to a lorry.
const ROAD_WHEEL: std::ops::Range<f64> = 0.55..2.2;

/// A column of numbers that may be something.
struct Known<'a> {
    head: &'a Head,
    told: Told,
}

/// Proposes a mapping for a text file.
///
/// # Errors
/// If it cannot be read, or is no table of numbers with names and stamps.
pub(super) fn suggest(log: &Path) -> Result<Suggestion, LogError> {
    let form = Form::of(log)?;
    let mut draft = Draft::default();
    let all = form.columns.iter().filter_map(|head| Some(Known { head, told: told(&head.name, &head.below)? }));
    let (known, words): (Vec<Known<'_>>, Vec<Known<'_>>) = all.partition(|known| known.head.words.is_none());
    for column in &words {
        let held = column.head.words.as_deref().unwrap_or_default();
        draft
            .undecided
            .push(format!("column {:?} holds what is no number ({held:?}) and is not taken", column.head.name));
    }
    let columns: Vec<Column> = known.iter().map(|known| known.head.column.clone()).collect();
    let sheet = Sheet::read(log, &form.layout, &columns)?;
    let (time, secs) = clock(&mut draft, &known, &words, &sheet)?;
    choose(&mut draft, &known, &sheet);
    draft.stand_in();
    draft.doubt_mass();
    let unused = form.columns.iter().filter(|head| told(&head.name, &head.below).is_none());
    let unused: Vec<&str> = unused.map(|head| head.name.as_str()).filter(|name| !name.is_empty()).collect();
    let beside =
        if unused.is_empty() { String::new() } else { format!(" (what is not known by name: {})", unused.join(", ")) };
    let heading = Heading { told_by: format!("columns and data{beside}"), log: laid_out(&form.layout), time, secs };
    let reader = Reader { log, sheet: &sheet, heading: &heading };
    let wheelbase = reader.decided(&mut draft, &known)?;
    if let Ok(mapping) = Mapping::parse(&draft.text(log, &heading, wheelbase)) {
        let found = mapping.check(log.parent().unwrap_or(Path::new(".")))?;
        let said = found.iter().map(|f| format!("{}: {} ({}); {}", f.channel, f.problem, f.evidence, f.proposal));
        draft.undecided.extend(said);
    }
    Ok(Suggestion { text: draft.text(log, &heading, wheelbase), undecided: draft.undecided })
}

/// Returns a name or number as TOML.
fn quoted(column: &Column) -> String {
    match column {
        Column::Number(number) => number.to_string(),
        Column::Name(name) => toml::Value::from(name.as_str()).to_string(),
    }
}

/// Returns the lines of `[log]` that say how a file is laid out.
fn laid_out(layout: &Layout) -> String {
    let text = |value: &str| toml::Value::from(value).to_string();
    let lines = [
        (layout.delimiter != ",").then(|| format!("delimiter = {}\n", text(&layout.delimiter))),
        (layout.decimal == Decimal::Comma).then(|| "decimal = \",\"\n".to_owned()),
        layout.comment.as_ref().map(|mark| format!("comment = {}\n", text(mark))),
        (layout.header == Header::Commented).then(|| "header = \"commented\"\n".to_owned()),
        (layout.skip > 0).then(|| format!("skip = {} # lines below the names that hold no numbers\n", layout.skip)),
    ];
    lines.into_iter().flatten().collect()
}

/// Chooses the stamps; returns their part of the mapping and how long the log is, s.
fn clock(
    draft: &mut Draft,
    known: &[Known<'_>],
    words: &[Known<'_>],
    sheet: &Sheet,
) -> Result<(String, f64), LogError> {
    let of_time = |all: &&Known<'_>| all.told.meaning == Meaning::Time;
    let grow = |known: &Known<'_>| sheet.column(&known.head.column).map_or(0, |stamps| growing(stamps).len());
    let times: Vec<&Known<'_>> = known.iter().filter(of_time).collect();
    let Some(best) = times.iter().rev().max_by_key(|time| grow(time)) else {
        let why = match words.iter().find(of_time) {
            Some(Known { head: Head { name, words, .. }, .. }) => format!(
                "its stamps {name:?} are no numbers ({:?}): a column of seconds is needed",
                words.as_deref().unwrap_or_default()
            ),
            None => "none of its columns is called as stamps are (time, t, timestamp …)".to_owned(),
        };
        return Err(LogError::NoTable { why, file: sheet.file.clone() });
    };
    let stamps = sheet.required(&best.head.column)?;
    let rows = growing(stamps);
    let mut steps: Vec<f64> = rows.windows(2).map(|pair| stamps[pair[1]] - stamps[pair[0]]).collect();
    if steps.is_empty() {
        let why = format!("its stamps {:?} do not grow", best.head.name);
        return Err(LogError::NoTable { why, file: sheet.file.clone() });
    }
    let step = (1e9 * ds_stats::quantile(&mut steps, 0.5)).round() / 1e9;
    let usual = |unit: &&str| seconds(unit).is_some_and(|secs| USUAL_STEP_SECS.contains(&(step * secs)));
    let fitting: Vec<&str> = ["s", "ms", "us", "ns"].into_iter().filter(usual).collect();
    let (unit, why) = match (best.told.unit, &fitting[..]) {
        (Some(unit), _) => (unit, String::new()),
        (None, [unit, others @ ..]) => {
            if !others.is_empty() {
                draft
                    .undecided
                    .push(format!("time: steps of {step} may be in {}; {unit} is taken", fitting.join(" or ")));
            }
            (*unit, format!(" # by the usual step of {step}"))
        }
        (None, []) => {
            draft.undecided.push(format!("time: steps of {step} are usual in no unit; s is taken"));
            ("s", String::new())
        }
    };
    let others: Vec<&str> =
        times.iter().filter(|time| !std::ptr::eq(**time, *best)).map(|t| t.head.name.as_str()).collect();
    if !others.is_empty() {
        let (name, others) = (&best.head.name, others.join(", "));
        draft.undecided.push(format!("time: {name:?} is taken; stamps are in {others} too"));
    }
    let secs = rows.first().zip(rows.last()).map_or(0.0, |(first, last)| stamps[*last] - stamps[*first]);
    let text = format!("\n[time]\ncolumn = {}\nunit = {unit:?}{why}\n", quoted(&best.head.column));
    Ok((text, secs * seconds(unit).unwrap_or(1.0)))
}

/// Takes the first column that moves for every channel.
fn choose(draft: &mut Draft, known: &[Known<'_>], sheet: &Sheet) {
    let moves = |known: &&Known<'_>| {
        let [low, high] = sheet.column(&known.head.column).map_or([0.0; 2], range);
        high - low > 1e-9
    };
    let names = |all: &[&Known<'_>]| all.iter().map(|known| known.head.to_string()).collect::<Vec<_>>().join(", ");
    let of = |meaning: Meaning| known.iter().filter(move |known| known.told.meaning == meaning);
    for channel in CHANNELS.map(|channel| channel.name) {
        let moving: Vec<&Known<'_>> = of(Meaning::Channel(channel)).filter(moves).collect();
        let Some(first) = moving.first() else {
            draft.undecided.extend(
                of(Meaning::Channel(channel))
                    .next()
                    .map(|k| format!("{channel}: {} never changes and is not taken", k.head)),
            );
            continue;
        };
        let is_side = |known: &&&Known<'_>| {
            channel == "v_wheel"
                && known.told.unit == first.told.unit
                && known.told.words.iter().any(|word| SIDES.contains(&word.as_str()))
        };
        let sides: Vec<&Known<'_>> = moving.iter().filter(is_side).copied().collect();
        let beside: Vec<&Known<'_>> = moving[1..].iter().filter(|known| !is_side(known)).copied().collect();
        if !beside.is_empty() {
            draft.undecided.push(format!("{channel}: {} is taken; it could be {} too", first.head, names(&beside)));
        }
        let mut entry = format!("column = {}", quoted(&first.head.column));
        if sides.len() > 1 {
            let more: Vec<String> = sides[1..].iter().map(|side| quoted(&side.head.column)).collect();
            entry = format!("column = {}, mean_with = [{}]", quoted(&sides[0].head.column), more.join(", "));
        }
        draft.lines.insert(channel, (entry, String::new()));
        draft.chosen.insert(channel, first.head.name.clone());
        draft.add(channel, first.told.more, "");
        match first.told.unit {
            Some(unit) => draft.add(channel, &format!("unit = {unit:?}"), ""),
            None if first.told.more.is_empty() => draft.open.push(channel),
            None => draft.undecided.push(format!("{channel}: the header says no unit; SI is taken")),
        }
        if let Some(sign) = &first.told.strange {
            draft.undecided.push(format!("{channel}: {sign:?} of {:?} is no unit that it can have", first.head.name));
        }
    }
    let fix = [Meaning::Latitude, Meaning::Longitude].map(|meaning| of(meaning).find(moves));
    if let ([Some(latitude), Some(longitude)], false) =
        (fix, ["x", "y"].iter().all(|name| draft.lines.contains_key(name)))
    {
        let entry = format!("fix = [{}, {}]", quoted(&latitude.head.column), quoted(&longitude.head.column));
        for name in ["x", "y"] {
            draft.lines.insert(name, (entry.clone(), String::new()));
            draft.chosen.insert(name, latitude.head.name.clone());
        }
        draft.open.retain(|name| !["x", "y"].contains(name));
    }
    if let Some(pedal) = of(Meaning::Pedal).next() {
        draft
            .undecided
            .push(format!("{:?}: what a pedal does would have to be fitted; it is not read", pedal.head.name));
    }
}

/// Reads the log as a draft says.
struct Reader<'a> {
    log: &'a Path,
    sheet: &'a Sheet,
    heading: &'a Heading,
}

impl Reader<'_> {
    /// Returns the longest stretch of what a draft with a further entry of the heading makes of the log.
    fn read(&self, draft: &Draft, heading: &str) -> Result<Option<Record>, LogError> {
        let mut draft = draft.clone();
        draft.add("yaw", heading, "");
        let mapping = Mapping::unchecked(&draft.text(self.log, self.heading, None))?;
        let half = 0.5 * (self.heading.secs - LOOKED_AT_SECS).max(0.0);
        let (file, from_secs, to_secs) = (self.sheet.file.clone(), half, half + LOOKED_AT_SECS);
        let log = mapping.of_sheet(self.sheet, &DriveFile { file, from_secs, to_secs, held_out: false })?;
        Ok(mapping.records(&log)?.into_iter().max_by_key(Record::samples))
    }

    /// Decides by the data what the header leaves open; returns the wheelbase, m, with how well it fits.
    fn decided(&self, draft: &mut Draft, known: &[Known<'_>]) -> Result<Option<(f64, f64)>, LogError> {
        let Some(plain) = self.read(draft, "")? else {
            draft
                .undecided
                .push("no stretch of 8 s without a hole is in the log, so that its data tell no unit".to_owned());
            return Ok(None);
        };
        let words = |channel: &str, sought: &[&str]| {
            let of = known.iter().filter(|known| draft.chosen.get(channel) == Some(&known.head.name));
            of.flat_map(|known| &known.told.words).any(|word| sought.contains(&word.as_str()))
        };
        let in_hands = [words("cmd_steer", &HANDS), words("steer_meas", &HANDS)];
        let ways: &[&'static str] = match (draft.open.contains(&"yaw"), words("yaw", &OF_COMPASS)) {
            _ if !draft.lines.contains_key("yaw") => &[],
            (true, true) => &["unit = \"deg\"", COMPASS[0], COMPASS[1]],
            (true, false) => &["unit = \"deg\""],
            (false, true) => &COMPASS[..1],
            (false, false) => &[],
        };
        let mut readings = vec![("", plain)];
        for way in ways {
            readings.extend(self.read(draft, way)?.map(|record| (*way, record)));
        }
        decide(draft, &readings);
        let mut wheelbase = None;
        for (name, in_hands) in ["cmd_steer", "steer_meas"].into_iter().zip(in_hands) {
            if let Some(record) = self.read(draft, "")?.filter(|record| record.channel(name).is_some()) {
                let base = steering(draft, name, in_hands, &record);
                wheelbase = wheelbase.or(base);
            }
        }
        Ok(wheelbase)
    }
}

/// Tells by how the vehicle turns whether an angle is that of the road wheels or of the steering wheel, and its unit where that is open;
/// returns the wheelbase, m, with how well it fits, where it is the road wheels' angle.
fn steering(draft: &mut Draft, name: &'static str, in_hands: bool, record: &Record) -> Option<(f64, f64)> {
    let told = wheelbase_m(record, name).filter(|(_, fit)| fit.abs() > STEERED);
    let Some((base, fit)) = told else {
        let what = if in_hands {
            "how far the road wheels turn with the steering wheel"
        } else {
            "whether it is the road wheels' angle"
        };
        draft.undecided.push(format!("{name}: turns do not tell {what}; set unit and scale (1 / ratio) by hand"));
        return None;
    };
    let units: &[(&str, f64)] =
        if draft.open.contains(&name) { &[("rad", 1.0), ("deg", 1f64.to_radians())] } else { &[("", 1.0)] };
    let of_road = base.abs() / WHEELBASE_M;
    for (unit, factor) in units {
        let ratio = of_road * factor;
        let is_road = ROAD_WHEEL.contains(&ratio);
        if !is_road && !STEERING_RATIO.contains(&ratio) {
            continue;
        }
        if !unit.is_empty() {
            draft.add(name, &format!("unit = {unit:?}"), "unit by the data: how the vehicle turns");
        }
        if is_road {
            if in_hands {
                draft.undecided.push(format!(
                    "{name}: it is called as a steering wheel is, but turns as the road wheels do; no ratio is set"
                ));
            }
            return (base > 0.0).then_some((ratio * WHEELBASE_M, fit));
        }
        draft.add(name, &format!("scale = {:.5}", 1.0 / ratio), "a steering wheel, by how the vehicle turns");
        draft.undecided.push(format!(
            "{name}: a steering wheel that turns {ratio:.1} times as far as the road wheels, if the wheelbase is {WHEELBASE_M} m; set scale = 1 / ratio of this vehicle"
        ));
        return None;
    }
    draft.undecided.push(format!(
        "{name}: the vehicle turns as if it were {of_road:.3} times the road wheels' angle, which no unit and no steering gear explains"
    ));
    None
}
