//! The text of a message definition → its structures: `TYPE NAME` a line, further types after lines of `=` and `MSG: TYPE`.
//!
//! Constants, defaults and comments are dropped. `time` and `duration` of ROS 1 are structures of `sec` and `nanosec`, as in ROS 2.

use std::collections::BTreeMap;

/// Most bytes, structures and fields of a definition; most levels of structures.
const MAX_TEXT: usize = 1 << 20;
const MAX_STRUCTURES: usize = 1_000;
const MAX_MEMBERS: usize = 10_000;
const MAX_DEPTH: usize = 24;

/// How messages are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Wire {
    /// ROS 1: one value after the other.
    Ros1,
    /// CDR of ROS 2: values aligned by their size.
    Cdr,
}

/// A number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Number {
    Bool,
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

/// What a field holds one of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Held {
    Number(Number),
    Text,
    /// Text of wide characters, whose size on the wire depends on the writer.
    WideText,
    /// A structure by its number.
    Structure(usize),
}

/// How many of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Count {
    One,
    Fixed(usize),
    Many,
}

/// A field.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Member {
    pub name: String,
    pub held: Held,
    pub count: Count,
}

/// A message type.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Structure {
    pub members: Vec<Member>,
    /// Takes no bytes on the wire.
    pub hollow: bool,
}

/// A message type with all that it is made of; the first structure is the message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Schema {
    pub structures: Vec<Structure>,
}

/// Returns the name of a type as ROS 1 writes it: `nav_msgs/Odometry`.
pub(crate) fn plain_name(kind: &str) -> String {
    kind.trim().replace("/msg/", "/")
}

impl Schema {
    /// Reads a definition.
    ///
    /// # Errors
    /// Why the text is none.
    pub(crate) fn parse(kind: &str, text: &str, wire: Wire) -> Result<Self, String> {
        if text.len() > MAX_TEXT {
            return Err(format!("a definition of {} bytes, more than {MAX_TEXT}", text.len()));
        }
        let mut texts: Vec<(String, Vec<&str>)> = vec![(plain_name(kind), Vec::new())];
        let mut separated = false;
        for line in text.lines().map(str::trim) {
            if line.len() >= 3 && line.bytes().all(|b| b == b'=') {
                separated = true;
            } else if let (true, Some(name)) = (separated, line.strip_prefix("MSG:")) {
                texts.push((plain_name(name), Vec::new()));
                separated = false;
            } else if let Some((_, lines)) = texts.last_mut() {
                lines.push(line);
            }
        }
        if texts.len() > MAX_STRUCTURES {
            return Err(format!("a definition of {} types, more than {MAX_STRUCTURES}", texts.len()));
        }
        let mut names: BTreeMap<String, usize> = BTreeMap::new();
        for (place, (name, _)) in texts.iter().enumerate() {
            names.entry(name.clone()).or_insert(place);
        }
        let stamp = texts.len();
        let mut structures = Vec::new();
        for (name, lines) in &texts {
            let members: Result<Vec<_>, _> =
                lines.iter().filter_map(|l| member(l, name, &names, stamp).transpose()).collect();
            structures.push(Structure { members: members?, hollow: false });
        }
        structures.extend([whole("sec", Number::U32), whole("sec", Number::I32)]);
        let mut schema = Self { structures };
        if schema.structures.iter().map(|s| s.members.len()).sum::<usize>() > MAX_MEMBERS {
            return Err(format!("a definition of more than {MAX_MEMBERS} fields"));
        }
        schema.finish(wire)?;
        Ok(schema)
    }

    /// Refuses circles and finds what takes no bytes, from the innermost structures outwards.
    fn finish(&mut self, wire: Wire) -> Result<(), String> {
        let mut levels = vec![None; self.structures.len()];
        for _ in 0..MAX_DEPTH {
            for place in 0..self.structures.len() {
                let inner = |m: &Member| match m.held {
                    Held::Structure(other) => levels[other],
                    _ => Some(0),
                };
                let deepest = self.structures[place].members.iter().map(inner).try_fold(0, |a, b| b.map(|b| a.max(b)));
                levels[place] = levels[place].or(deepest.map(|d: usize| d + 1));
            }
        }
        if levels[0].is_none() {
            return Err(format!("its types hold each other, or more than {MAX_DEPTH} levels"));
        }
        let mut order: Vec<usize> = (0..levels.len()).filter(|k| levels[*k].is_some()).collect();
        order.sort_by_key(|k| levels[*k]);
        for place in order {
            // the generator of ROS 2 gives a message without fields one byte
            if wire == Wire::Cdr && self.structures[place].members.is_empty() {
                let name = "structure_needs_at_least_one_member".to_owned();
                let byte = Member { name, held: Held::Number(Number::U8), count: Count::One };
                self.structures[place].members.push(byte);
            }
            let hollow = |m: &Member| match (&m.held, m.count) {
                (_, Count::Many) => false,
                (_, Count::Fixed(0)) => true,
                (Held::Structure(other), _) => self.structures[*other].hollow,
                _ => false,
            };
            self.structures[place].hollow = self.structures[place].members.iter().all(hollow);
        }
        Ok(())
    }
}

/// A moment or a span of time.
fn whole(seconds: &str, kind: Number) -> Structure {
    let nanos = if kind == Number::U32 { Number::U32 } else { kind };
    let part = |name: &str, number| Member { name: name.to_owned(), held: Held::Number(number), count: Count::One };
    Structure { members: vec![part(seconds, kind), part("nanosec", nanos)], hollow: false }
}

/// Reads a line; `None` where it declares no field.
fn member(line: &str, owner: &str, names: &BTreeMap<String, usize>, stamp: usize) -> Result<Option<Member>, String> {
    let line = line.split('#').next().unwrap_or_default().trim();
    let Some((kind, rest)) = line.split_once(char::is_whitespace) else {
        return if line.is_empty() {
            Ok(None)
        } else {
            Err(format!("definition of {owner}: a field without a name in {line:?}"))
        };
    };
    let rest = rest.trim_start();
    let end = rest.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).unwrap_or(rest.len());
    let (name, after) = rest.split_at(end);
    if name.is_empty() {
        return Err(format!("definition of {owner}: a field without a name in {line:?}"));
    }
    if after.trim_start().starts_with('=') {
        return Ok(None);
    }
    let (base, count) = match kind.split_once('[') {
        None => (kind, Count::One),
        Some((base, bound)) => {
            (base, counted(bound).ok_or_else(|| format!("definition of {owner}: {kind:?} is no array"))?)
        }
    };
    let held = held(base.split("<=").next().unwrap_or(base), owner, names, stamp)?;
    Ok(Some(Member { name: name.to_owned(), held, count }))
}

fn counted(bound: &str) -> Option<Count> {
    let bound = bound.strip_suffix(']')?;
    if bound.is_empty() || bound.starts_with("<=") { Some(Count::Many) } else { bound.parse().ok().map(Count::Fixed) }
}

fn held(base: &str, owner: &str, names: &BTreeMap<String, usize>, stamp: usize) -> Result<Held, String> {
    let number = match base {
        "bool" => Number::Bool,
        "int8" => Number::I8,
        "uint8" | "byte" | "char" => Number::U8,
        "int16" => Number::I16,
        "uint16" => Number::U16,
        "int32" => Number::I32,
        "uint32" => Number::U32,
        "int64" => Number::I64,
        "uint64" => Number::U64,
        "float32" => Number::F32,
        "float64" => Number::F64,
        "string" => return Ok(Held::Text),
        "wstring" => return Ok(Held::WideText),
        "time" => return Ok(Held::Structure(stamp)),
        "duration" => return Ok(Held::Structure(stamp + 1)),
        other => {
            let other = plain_name(other);
            let package = owner.split_once('/').map_or("", |(package, _)| package);
            let places = [other.clone(), format!("{package}/{other}"), format!("std_msgs/{other}")];
            let found = places.iter().find_map(|name| names.get(name));
            return match (found, other.as_str()) {
                (Some(place), _) => Ok(Held::Structure(*place)),
                (None, "builtin_interfaces/Time") => Ok(Held::Structure(stamp)),
                (None, "builtin_interfaces/Duration") => Ok(Held::Structure(stamp + 1)),
                _ => Err(format!("definition of {owner}: the type {other:?} is not in it")),
            };
        }
    };
    Ok(Held::Number(number))
}

impl Number {
    /// Returns its size in bytes.
    pub(crate) const fn size(self) -> usize {
        match self {
            Self::Bool | Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_constants_comments_and_bounds() {
        let text = "# a message\nHeader header\nint8 LOW=-1 # least\nstring NAME = a#b\nfloat64[36] c\nfloat32[<=4] d 1\n\
                    string<=10[] names\nInner inner\ntime at\n\
                    ====\nMSG: std_msgs/Header\nuint32 seq\n===\nMSG: own_msgs/msg/Inner\nbool ok true\n";
        let schema = Schema::parse("own_msgs/msg/Outer", text, Wire::Ros1).expect("a definition");
        let outer = &schema.structures[0].members;
        let names: Vec<&str> = outer.iter().map(|m| m.name.as_str()).collect();
        assert_eq!(names, ["header", "c", "d", "names", "inner", "at"]);
        let counts: Vec<Count> = outer.iter().map(|m| m.count).collect();
        assert_eq!(counts, [Count::One, Count::Fixed(36), Count::Many, Count::Many, Count::One, Count::One]);
        assert_eq!(outer[0].held, Held::Structure(1));
        assert_eq!(outer[5].held, Held::Structure(3));
    }

    #[test]
    fn what_is_no_definition_is_refused_by_name() {
        for (text, wanted) in [
            ("Missing m", "Missing"),
            ("float64[x] a", "float64[x]"),
            ("float64", "without a name"),
            ("A a\n===\nMSG: p/A\nB b\n===\nMSG: p/B\nA a", "hold each other"),
        ] {
            let error = Schema::parse("p/Root", text, Wire::Cdr).expect_err("no definition");
            assert!(error.contains(wanted), "{error} lacks {wanted}");
        }
    }

    #[test]
    fn a_message_without_fields_takes_no_bytes_in_ros_1_and_one_in_ros_2() {
        let hollow =
            |wire| Schema::parse("std_msgs/Empty", "int8 A=1", wire).expect("a definition").structures[0].hollow;
        assert!(hollow(Wire::Ros1) && !hollow(Wire::Cdr));
    }
}
