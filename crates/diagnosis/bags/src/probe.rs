//! Named fields of named topics → columns with stamps, in one pass over a bag.
//!
//! A path is `name.name[2].name`. It ends at a number, or at a structure that stands for one: a quaternion (`x`, `y`, `z`, `w`) gives
//! the heading about the vertical, rad; `east` and `north` behind a structure with `latitude` and `longitude` give metres
//! from the bag's first fix on the plane that touches the WGS 84 ellipsoid there. A wanted element that a list
//! does not have is NaN.

use std::collections::BTreeMap;
use std::path::Path;

use crate::container::{Declared, Format, Message, Sink};
use crate::definition::{Count, Held, Schema, Wire};
use crate::error::BagError;
use crate::fix::Plane;
use crate::wire::Bytes;

/// Most messages of a topic: 5 h at 200 Hz.
const MAX_MESSAGES: usize = 3_600_000;

/// Which of a message's stamps is its time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Clock {
    /// The stamp of its header, or of itself, where its type has one; else when it was received.
    #[default]
    Own,
    /// When it was received.
    Log,
    /// When it was sent, as the container says.
    Publish,
}

/// A number sought in every message of a topic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Wanted {
    /// The topic.
    pub topic: String,
    /// Path to the field.
    pub field: String,
    /// Which stamp counts.
    pub clock: Clock,
}

/// What was found of it, in the order of the bag.
#[derive(Debug, Clone, Default)]
pub struct Series {
    /// Stamps, ns.
    pub nanos: Vec<i64>,
    /// Values.
    pub values: Vec<f64>,
}

/// What was found of it, in short.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Glance {
    /// First stamp in the order of the bag, ns.
    pub first_nanos: Option<i64>,
    /// Earliest and latest stamp, ns.
    pub span_nanos: Option<(i64, i64)>,
    /// Least and largest value that is a number.
    pub range: Option<(f64, f64)>,
}

/// Takes fields out of a bag; one series for each that is wanted.
///
/// # Errors
/// If the bag is damaged or too large, or a topic or field is not in it.
pub fn series(path: &Path, format: Format, wanted: &[Wanted]) -> Result<Vec<Series>, BagError> {
    let mut found = vec![Series::default(); wanted.len()];
    each(path, format, wanted, &mut |place, nanos, value| {
        let series = &mut found[place];
        if series.nanos.len() >= MAX_MESSAGES {
            let what = format!("messages of topic {:?}", wanted[place].topic);
            return Err(BagError::TooLarge { what, limit: MAX_MESSAGES, path: path.to_path_buf() });
        }
        series.nanos.push(nanos);
        series.values.push(value);
        Ok(())
    })?;
    Ok(found)
}

/// Looks at fields of a bag without keeping their values.
///
/// # Errors
/// If the bag is damaged, or a topic or field is not in it.
pub fn glance(path: &Path, format: Format, wanted: &[Wanted]) -> Result<Vec<Glance>, BagError> {
    let mut found = vec![Glance::default(); wanted.len()];
    each(path, format, wanted, &mut |place, nanos, value| {
        let glance = &mut found[place];
        glance.first_nanos.get_or_insert(nanos);
        let (low, high) = glance.span_nanos.unwrap_or((nanos, nanos));
        glance.span_nanos = Some((low.min(nanos), high.max(nanos)));
        if value.is_finite() {
            let (low, high) = glance.range.unwrap_or((value, value));
            glance.range = Some((low.min(value), high.max(value)));
        }
        Ok(())
    })?;
    Ok(found)
}

/// Takes the number of what is wanted, a stamp and a value.
type Take<'a> = &'a mut dyn FnMut(usize, i64, f64) -> Result<(), BagError>;

fn each(path: &Path, format: Format, wanted: &[Wanted], take: Take<'_>) -> Result<(), BagError> {
    let mut taker = Taker { wanted, take, probes: BTreeMap::new(), seen: Vec::new(), origin: Plane::default() };
    format.read(path, &mut taker)?;
    for sought in wanted {
        if !taker.seen.iter().any(|(name, _)| *name == sought.topic) {
            let found = taker.seen.iter().map(|(name, kind)| format!("{name} ({kind})")).collect();
            return Err(BagError::NoTopic { topic: sought.topic.clone(), found, path: path.to_path_buf() });
        }
    }
    Ok(())
}

/// Fields to be read of a structure, by the place of the member: which element of it, and what of that.
#[derive(Debug, Default)]
struct Node {
    members: BTreeMap<usize, Vec<(Option<usize>, Node)>>,
    /// Where the number goes.
    slots: Vec<usize>,
}

/// How numbers become a value.
#[derive(Debug, Clone, Copy)]
enum Value {
    Number(usize),
    Heading([usize; 4]),
    East([usize; 2]),
    North([usize; 2]),
}

/// How the messages of one topic are read.
struct Probe {
    topic: String,
    schema: Schema,
    wire: Wire,
    root: Node,
    slots: usize,
    stamp: Option<[usize; 2]>,
    /// Number of the series, its clock and value.
    values: Vec<(usize, Clock, Value)>,
    numbers: Vec<f64>,
    messages: u64,
}

struct Taker<'a> {
    wanted: &'a [Wanted],
    take: Take<'a>,
    probes: BTreeMap<u32, Probe>,
    /// Names and types of the topics.
    seen: Vec<(String, String)>,
    /// Latitude and longitude of the first fix, rad.
    origin: Plane,
}

impl Sink for Taker<'_> {
    fn begin(&mut self, _path: &Path) {
        self.probes.clear();
    }

    fn topic(&mut self, number: u32, declared: Declared) -> Result<bool, BagError> {
        self.seen.push((declared.name.clone(), declared.kind.clone()));
        let sought: Vec<(usize, &Wanted)> =
            self.wanted.iter().enumerate().filter(|(_, w)| w.topic == declared.name).collect();
        if sought.is_empty() {
            return Ok(false);
        }
        self.probes.insert(number, Probe::new(declared, &sought)?);
        Ok(true)
    }

    fn message(&mut self, message: &Message<'_>) -> Result<(), BagError> {
        let Some(probe) = self.probes.get_mut(&message.topic) else { return Ok(()) };
        probe.messages += 1;
        let refused = |what, topic: &str, number| BagError::Message { number, topic: topic.to_owned(), what };
        if let Err(what) = probe.read(message.data) {
            return Err(refused(what, &probe.topic, probe.messages));
        }
        for &(place, clock, value) in &probe.values {
            let nanos = match probe.nanos(clock, message) {
                Ok(nanos) => nanos,
                Err(what) => return Err(refused(what.to_owned(), &probe.topic, probe.messages)),
            };
            (self.take)(place, nanos, value.of(&probe.numbers, &mut self.origin))?;
        }
        Ok(())
    }
}

impl Value {
    fn of(self, numbers: &[f64], origin: &mut Plane) -> f64 {
        let mut fix = |slots: [usize; 2]| origin.place(slots.map(|slot| numbers[slot]));
        match self {
            Self::Number(slot) => numbers[slot],
            Self::Heading(slots) => {
                let [x, y, z, w] = slots.map(|slot| numbers[slot]);
                // all zero is what a sensor without orientation writes
                if x == 0.0 && y == 0.0 && z == 0.0 && w == 0.0 {
                    f64::NAN
                } else {
                    (2.0 * (w * z + x * y)).atan2(w * w + x * x - y * y - z * z)
                }
            }
            Self::East(slots) => fix(slots)[0],
            Self::North(slots) => fix(slots)[1],
        }
    }
}

impl Probe {
    fn new(declared: Declared, sought: &[(usize, &Wanted)]) -> Result<Self, BagError> {
        let Declared { name: topic, kind, wire, definition } = declared;
        let schema = definition.and_then(|text| Schema::parse(&kind, &text, wire));
        let schema = schema.map_err(|what| BagError::Definition { topic: topic.clone(), kind: kind.clone(), what })?;
        let mut probe = Self {
            topic,
            schema,
            wire,
            root: Node::default(),
            slots: 0,
            stamp: None,
            values: Vec::new(),
            numbers: Vec::new(),
            messages: 0,
        };
        probe.stamp = ["header.stamp.", "stamp."].iter().find_map(|path| {
            let mut slot = |part| probe.slot(&format!("{path}{part}")).ok();
            Some([slot("sec")?, slot("nanosec")?])
        });
        for (place, wanted) in sought {
            let value = probe.value(&wanted.field).map_err(|what| BagError::NoField {
                field: wanted.field.clone(),
                topic: probe.topic.clone(),
                kind: kind.clone(),
                what,
            })?;
            probe.values.push((*place, wanted.clock, value));
        }
        probe.numbers = vec![f64::NAN; probe.slots];
        Ok(probe)
    }

    /// Finds a path that ends at a number or at what stands for one.
    fn value(&mut self, field: &str) -> Result<Value, String> {
        let before = |last: &str| field.strip_suffix(last).filter(|p| p.is_empty() || p.ends_with('.'));
        let plain = self.slot(field);
        if let Ok(slot) = plain {
            return Ok(Value::Number(slot));
        }
        for (last, make) in [("east", Value::East as fn([usize; 2]) -> Value), ("north", Value::North)] {
            if let Some(prefix) = before(last) {
                let slots = [self.slot(&format!("{prefix}latitude"))?, self.slot(&format!("{prefix}longitude"))?];
                return Ok(make(slots));
            }
        }
        let part = |probe: &mut Self, name: &str| probe.slot(&format!("{field}.{name}"));
        match (part(self, "x"), part(self, "y"), part(self, "z"), part(self, "w")) {
            (Ok(x), Ok(y), Ok(z), Ok(w)) => Ok(Value::Heading([x, y, z, w])),
            _ => plain.map(Value::Number),
        }
    }

    /// Makes room for the number at a path.
    fn slot(&mut self, field: &str) -> Result<usize, String> {
        let steps = steps(&self.schema, field)?;
        let mut node = &mut self.root;
        for (member, element) in steps {
            let branches = node.members.entry(member).or_default();
            let known = branches.iter().position(|(e, _)| *e == element);
            let place = known.unwrap_or_else(|| {
                branches.push((element, Node::default()));
                branches.len() - 1
            });
            node = &mut branches[place].1;
        }
        node.slots.push(self.slots);
        self.slots += 1;
        Ok(self.slots - 1)
    }

    fn nanos(&self, clock: Clock, message: &Message<'_>) -> Result<i64, &'static str> {
        match (clock, self.stamp) {
            (Clock::Own, Some(slots)) => {
                let [sec, nanosec] = slots.map(|slot| self.numbers[slot]);
                Ok(sec as i64 * 1_000_000_000 + nanosec as i64)
            }
            (Clock::Own, None) | (Clock::Log, _) => Ok(message.log_nanos),
            (Clock::Publish, _) => message.publish_nanos.ok_or("this container does not say when a message was sent"),
        }
    }

    fn read(&mut self, data: &[u8]) -> Result<(), String> {
        if self.messages == 1 {
            fits(&self.schema, self.wire, data)?;
        }
        self.numbers.fill(f64::NAN);
        let mut bytes = Bytes::new(data, self.wire)?;
        let mut out = Found { numbers: &mut self.numbers, left: self.slots };
        walk(&self.schema, 0, &self.root, &mut bytes, &mut out)
    }
}

/// Refuses a definition that leaves bytes of a message over: that of another version.
fn fits(schema: &Schema, wire: Wire, data: &[u8]) -> Result<(), String> {
    let mut bytes = Bytes::new(data, wire)?;
    let wide = |m: &crate::definition::Member| m.held == Held::WideText;
    if schema.structures.iter().any(|s| s.members.iter().any(wide)) {
        return Ok(());
    }
    bytes.skip_one(schema, &Held::Structure(0))?;
    let over = bytes.left();
    if over < 8 {
        Ok(())
    } else {
        Err(format!("{over} bytes are left over: the definition is that of another version"))
    }
}

/// Returns the members and elements that a path leads through.
fn steps(schema: &Schema, field: &str) -> Result<Vec<(usize, Option<usize>)>, String> {
    let mut place = Some(0);
    let mut steps = Vec::new();
    let mut walked = String::new();
    for part in field.split('.') {
        let (name, element) = match part.split_once('[') {
            None => (part, None),
            Some((name, index)) => {
                let index = index.strip_suffix(']').and_then(|i| i.parse::<usize>().ok());
                (name, Some(index.ok_or_else(|| format!("{part:?} is no element"))?))
            }
        };
        let structure = place.ok_or_else(|| format!("{walked:?} is a number or text"))?;
        let members = &schema.structures[structure].members;
        let found = members.iter().position(|m| m.name == name).ok_or_else(|| {
            let there: Vec<&str> = members.iter().map(|m| m.name.as_str()).collect();
            format!(
                "{} has {there:?}",
                if walked.is_empty() { "the message".to_owned() } else { format!("{walked:?}") }
            )
        })?;
        match (members[found].count, element) {
            (Count::One, Some(_)) => return Err(format!("{name:?} is no list")),
            (Count::Fixed(_) | Count::Many, None) => {
                return Err(format!("{name:?} is a list: name an element, {name}[0]"));
            }
            (Count::Fixed(count), Some(index)) if index >= count => {
                return Err(format!("{name:?} has {count} elements"));
            }
            _ => {}
        }
        steps.push((found, element));
        walked = if walked.is_empty() { part.to_owned() } else { format!("{walked}.{part}") };
        place = match members[found].held {
            Held::Structure(other) => Some(other),
            Held::Number(_) => None,
            Held::Text | Held::WideText => return Err(format!("{walked:?} is text")),
        };
    }
    if place.is_some() { Err(format!("{walked:?} is a structure")) } else { Ok(steps) }
}

/// Where numbers go, and how many are still to come.
struct Found<'a> {
    numbers: &'a mut [f64],
    left: usize,
}

/// Reads the wanted numbers of a structure; ends as soon as none is left.
fn walk(schema: &Schema, place: usize, node: &Node, bytes: &mut Bytes<'_>, out: &mut Found<'_>) -> Result<(), String> {
    for (index, member) in schema.structures[place].members.iter().enumerate() {
        if out.left == 0 {
            return Ok(());
        }
        let Some(branches) = node.members.get(&index) else {
            bytes.skip(schema, member)?;
            continue;
        };
        let count = bytes.count(member.count)?;
        bytes.fits(count)?;
        let mut met = 0;
        for element in 0..count {
            let branch = branches.iter().find(|(wanted, _)| wanted.is_none_or(|w| w == element));
            match (branch, &member.held) {
                (Some((_, inner)), Held::Structure(other)) => walk(schema, *other, inner, bytes, out)?,
                (Some((_, inner)), Held::Number(kind)) => {
                    let value = bytes.number(*kind)?;
                    inner.slots.iter().for_each(|slot| out.numbers[*slot] = value);
                    out.left -= inner.slots.len();
                }
                _ => bytes.skip_one(schema, &member.held)?,
            }
            met += usize::from(branch.is_some());
        }
        if met < branches.len() {
            // an element that the list does not have will not come: read on to the end
            out.left = usize::MAX / 2;
        }
    }
    Ok(())
}
