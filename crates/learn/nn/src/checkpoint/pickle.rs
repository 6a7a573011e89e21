//! The tensors of a pickle as PyTorch writes it, without running anything.
//!
//! The interpreter knows the opcodes that `torch.save` emits and a closed list of names: ordered dictionaries, sizes,
//! storages and the functions that rebuild tensors. Any other name ends it. Values lie in one flat arena of bounded
//! length, so that neither nesting nor repetition can exhaust stack or memory.

use std::collections::BTreeMap;

/// The longest accepted pickle, in bytes.
const MAX_BYTES: usize = 16 << 20;
const MAX_VALUES: usize = 1 << 18;
const MAX_DEPTH: usize = 8;
const MAX_NAME: usize = 512;
const MAX_AXES: usize = 8;

/// A tensor of the pickle: where its values lie in a storage.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Stored {
    /// Name of the storage's member.
    pub(super) key: String,
    /// Type of the storage, such as `BFloat16Storage`.
    pub(super) storage: String,
    /// First value.
    pub(super) offset: usize,
    pub(super) shape: Vec<usize>,
    pub(super) strides: Vec<usize>,
}

/// Says why a pickle is refused.
#[derive(Debug, PartialEq)]
pub(super) enum Fault {
    /// It is broken at a byte.
    Broken { at: usize, reason: String },
    /// It names code.
    Code(String),
}

#[derive(Debug, Clone, Copy)]
enum Value {
    None,
    Bool,
    Int(i64),
    Float,
    Mark,
    Node(usize),
}

#[derive(Debug)]
enum Node {
    Text(String),
    Tuple(Vec<Value>),
    List(Vec<Value>),
    Dict(Vec<(Value, Value)>),
    Function(Function),
    Storage { key: String, kind: String },
    Tensor(Box<Stored>),
}

#[derive(Debug, Clone, PartialEq)]
enum Function {
    OrderedDict,
    Size,
    Tensor,
    Parameter,
    Storage(String),
}

impl Function {
    /// The closed list of names.
    fn named(module: &str, name: &str) -> Option<Self> {
        let storages = ["Float", "Half", "BFloat16", "Double", "Long", "Int", "Short", "Char", "Byte", "Bool"];
        match (module, name) {
            ("collections", "OrderedDict") => Some(Self::OrderedDict),
            ("torch", "Size") => Some(Self::Size),
            ("torch._utils", "_rebuild_tensor_v2" | "_rebuild_tensor") => Some(Self::Tensor),
            ("torch._utils", "_rebuild_parameter") => Some(Self::Parameter),
            ("torch", _) if storages.contains(&name.strip_suffix("Storage")?) => Some(Self::Storage(name.to_owned())),
            _ => None,
        }
    }
}

struct Machine<'a> {
    bytes: &'a [u8],
    at: usize,
    stack: Vec<Value>,
    nodes: Vec<Node>,
    memo: BTreeMap<usize, Value>,
}

#[derive(Default)]
struct Found {
    tensors: BTreeMap<String, Stored>,
    visited: usize,
}

/// Returns the tensors of a pickled dictionary by name; names of nested dictionaries are joined with dots.
pub(super) fn tensors(bytes: &[u8]) -> Result<BTreeMap<String, Stored>, Fault> {
    if bytes.len() > MAX_BYTES {
        let reason = format!("it has {} bytes, at most {MAX_BYTES} are read", bytes.len());
        return Err(Fault::Broken { at: 0, reason });
    }
    let mut machine = Machine { bytes, at: 0, stack: Vec::new(), nodes: Vec::new(), memo: BTreeMap::new() };
    let root = machine.run()?;
    let mut found = Found::default();
    machine.collect(root, "", 0, &mut found)?;
    Ok(found.tensors)
}

impl Machine<'_> {
    fn broken<T>(&self, reason: impl Into<String>) -> Result<T, Fault> {
        Err(Fault::Broken { at: self.at, reason: reason.into() })
    }

    fn take(&mut self, count: usize) -> Result<&[u8], Fault> {
        let end = self.at.checked_add(count).filter(|end| *end <= self.bytes.len());
        let Some(end) = end else { return self.broken("it ends in the middle") };
        let slice = &self.bytes[self.at..end];
        self.at = end;
        Ok(slice)
    }

    fn number<const N: usize>(&mut self) -> Result<usize, Fault> {
        let mut value = [0; 8];
        value[..N].copy_from_slice(self.take(N)?);
        let value = u64::from_le_bytes(value);
        match usize::try_from(value) {
            Ok(value) => Ok(value),
            Err(_) => self.broken(format!("the length {value} is too large")),
        }
    }

    fn line(&mut self) -> Result<String, Fault> {
        let rest = &self.bytes[self.at..];
        let Some(length) = rest.iter().position(|byte| *byte == b'\n') else {
            return self.broken("a name has no end");
        };
        let text = String::from_utf8_lossy(&rest[..length]).into_owned();
        self.at += length + 1;
        Ok(text)
    }

    fn text(&mut self, length: usize) -> Result<(), Fault> {
        let text = String::from_utf8_lossy(self.take(length)?).into_owned();
        self.push(Node::Text(text));
        Ok(())
    }

    fn push(&mut self, node: Node) {
        self.nodes.push(node);
        self.stack.push(Value::Node(self.nodes.len() - 1));
    }

    fn pop(&mut self) -> Result<Value, Fault> {
        match self.stack.pop() {
            Some(value) => Ok(value),
            None => self.broken("its stack is empty"),
        }
    }

    /// Takes what lies above the last mark.
    fn marked(&mut self) -> Result<Vec<Value>, Fault> {
        let Some(mark) = self.stack.iter().rposition(|value| matches!(value, Value::Mark)) else {
            return self.broken("a mark is missing");
        };
        let values = self.stack.split_off(mark + 1);
        self.stack.pop();
        Ok(values)
    }

    fn node(&self, value: Value) -> Option<&Node> {
        match value {
            Value::Node(index) => self.nodes.get(index),
            _ => None,
        }
    }

    fn text_of(&self, value: Value) -> Option<&str> {
        match self.node(value)? {
            Node::Text(text) => Some(text),
            _ => None,
        }
    }

    fn tuple_of(&self, value: Value) -> Option<&[Value]> {
        match self.node(value)? {
            Node::Tuple(values) => Some(values),
            _ => None,
        }
    }

    fn run(&mut self) -> Result<Value, Fault> {
        loop {
            let opcode = self.take(1)?[0];
            if opcode == b'.' {
                return self.pop();
            }
            self.step(opcode)?;
            if self.nodes.len().max(self.stack.len()) > MAX_VALUES {
                return self.broken(format!("it makes over {MAX_VALUES} values"));
            }
        }
    }

    fn step(&mut self, opcode: u8) -> Result<(), Fault> {
        match opcode {
            0x80 => self.take(1).map(|_| ()),
            0x95 => self.take(8).map(|_| ()),
            b'(' => {
                self.stack.push(Value::Mark);
                Ok(())
            }
            b'0' => self.pop().map(|_| ()),
            b'N' | 0x88 | 0x89 | b'J' | b'K' | b'M' | 0x8a | b'G' => self.scalar(opcode),
            b'X' => self.number::<4>().and_then(|length| self.text(length)),
            0x8c | b'U' => self.number::<1>().and_then(|length| self.text(length)),
            b'c' => {
                let (module, name) = (self.line()?, self.line()?);
                self.global(&module, &name)
            }
            0x93 => {
                let (name, module) = (self.pop()?, self.pop()?);
                let pair = self.text_of(module).zip(self.text_of(name));
                let Some((module, name)) = pair.map(|(module, name)| (module.to_owned(), name.to_owned())) else {
                    return self.broken("a name is not text");
                };
                self.global(&module, &name)
            }
            b'q' | b'r' | 0x94 | b'h' | b'j' => self.remember(opcode),
            b'Q' => self.storage(),
            b'R' => self.reduce(),
            // The state of a dictionary is the version table of its modules; that of a tensor is not needed.
            b'b' => self.pop().map(|_| ()),
            _ => self.collection(opcode),
        }
    }

    fn scalar(&mut self, opcode: u8) -> Result<(), Fault> {
        let value = match opcode {
            b'N' => Value::None,
            b'J' => {
                let bytes = self.take(4)?;
                Value::Int(i64::from(i32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])))
            }
            b'K' => Value::Int(i64::from(self.take(1)?[0])),
            b'M' => {
                let bytes = self.take(2)?;
                Value::Int(i64::from(u16::from_le_bytes([bytes[0], bytes[1]])))
            }
            0x8a => {
                let length = self.number::<1>()?;
                let bytes = self.take(length)?;
                if bytes.len() > 8 {
                    return self.broken("an integer has over 64 bits");
                }
                let fill = if bytes.last().is_some_and(|byte| byte & 0x80 != 0) { 0xff } else { 0 };
                let mut value = [fill; 8];
                value[..bytes.len()].copy_from_slice(bytes);
                Value::Int(i64::from_le_bytes(value))
            }
            b'G' => {
                self.take(8)?;
                Value::Float
            }
            _ => Value::Bool,
        };
        self.stack.push(value);
        Ok(())
    }

    fn collection(&mut self, opcode: u8) -> Result<(), Fault> {
        match opcode {
            b'}' => self.push(Node::Dict(Vec::new())),
            b']' => self.push(Node::List(Vec::new())),
            b')' => self.push(Node::Tuple(Vec::new())),
            b't' => {
                let values = self.marked()?;
                self.push(Node::Tuple(values));
            }
            0x85..=0x87 => {
                let count = usize::from(opcode - 0x84);
                let Some(first) = self.stack.len().checked_sub(count) else {
                    return self.broken("its stack is empty");
                };
                let values = self.stack.split_off(first);
                self.push(Node::Tuple(values));
            }
            b'a' => {
                let value = self.pop()?;
                self.extend(vec![value])?;
            }
            b'e' => {
                let values = self.marked()?;
                self.extend(values)?;
            }
            b's' => {
                let (value, key) = (self.pop()?, self.pop()?);
                self.set(&[key, value])?;
            }
            b'u' => {
                let values = self.marked()?;
                self.set(&values)?;
            }
            _ => return self.broken(format!("opcode 0x{opcode:02x} is not one that tensors need")),
        }
        Ok(())
    }

    fn extend(&mut self, values: Vec<Value>) -> Result<(), Fault> {
        if let Some(Value::Node(index)) = self.stack.last().copied()
            && let Some(Node::List(list)) = self.nodes.get_mut(index)
        {
            list.extend(values);
            return Ok(());
        }
        self.broken("it appends to what is no list")
    }

    fn set(&mut self, values: &[Value]) -> Result<(), Fault> {
        if let Some(Value::Node(index)) = self.stack.last().copied()
            && let Some(Node::Dict(pairs)) = self.nodes.get_mut(index)
            && values.len().is_multiple_of(2)
        {
            pairs.extend(values.chunks_exact(2).map(|pair| (pair[0], pair[1])));
            return Ok(());
        }
        self.broken("it sets an entry of what is no dictionary")
    }

    fn remember(&mut self, opcode: u8) -> Result<(), Fault> {
        let slot = match opcode {
            b'q' | b'h' => self.number::<1>()?,
            b'r' | b'j' => self.number::<4>()?,
            _ => self.memo.len(),
        };
        if matches!(opcode, b'h' | b'j') {
            let Some(value) = self.memo.get(&slot).copied() else {
                return self.broken("it recalls what it never kept");
            };
            self.stack.push(value);
        } else {
            let Some(value) = self.stack.last().copied() else { return self.broken("its stack is empty") };
            self.memo.insert(slot, value);
        }
        Ok(())
    }

    fn global(&mut self, module: &str, name: &str) -> Result<(), Fault> {
        match Function::named(module, name) {
            Some(function) => {
                self.push(Node::Function(function));
                Ok(())
            }
            None => Err(Fault::Code(format!("{module}.{name}"))),
        }
    }

    /// Resolves ("storage", type, key, device, count).
    fn storage(&mut self) -> Result<(), Fault> {
        let id = self.pop()?;
        let parts = self.tuple_of(id).and_then(|parts| {
            let [kind, storage, key, ..] = parts else { return None };
            let Node::Function(Function::Storage(storage)) = self.node(*storage)? else { return None };
            (self.text_of(*kind)? == "storage").then_some((self.text_of(*key)?.to_owned(), storage.clone()))
        });
        let Some((key, kind)) = parts else { return self.broken("a persistent value is not a storage") };
        self.push(Node::Storage { key, kind });
        Ok(())
    }

    fn reduce(&mut self) -> Result<(), Fault> {
        let (arguments, function) = (self.pop()?, self.pop()?);
        // No function looks at more than its first four arguments.
        let first = |values: &[Value]| values[..values.len().min(5)].to_vec();
        let Some(arguments) = self.tuple_of(arguments).map(first) else {
            return self.broken("a call has no tuple of arguments");
        };
        let Some(Node::Function(function)) = self.node(function) else {
            return self.broken("it calls what is no function");
        };
        match (function.clone(), arguments.as_slice()) {
            (Function::OrderedDict, []) => self.push(Node::Dict(Vec::new())),
            (Function::Size, [size]) => self.stack.push(*size),
            (Function::Parameter, [tensor, ..]) => self.stack.push(*tensor),
            (Function::Tensor, [storage, offset, shape, strides, ..]) => {
                let tensor = self.tensor(*storage, *offset, *shape, *strides);
                let Some(tensor) = tensor else { return self.broken("a tensor is described wrongly") };
                self.push(Node::Tensor(Box::new(tensor)));
            }
            (function, arguments) => {
                return self.broken(format!("a call of {function:?} has {} arguments", arguments.len()));
            }
        }
        Ok(())
    }

    fn tensor(&self, storage: Value, offset: Value, shape: Value, strides: Value) -> Option<Stored> {
        let Node::Storage { key, kind } = self.node(storage)? else { return None };
        let size = |value: &Value| match value {
            Value::Int(value) => usize::try_from(*value).ok(),
            _ => None,
        };
        let sizes = |value: Value| {
            let values = self.tuple_of(value).filter(|values| values.len() <= MAX_AXES)?;
            values.iter().map(size).collect::<Option<Vec<usize>>>()
        };
        let (shape, strides) = (sizes(shape)?, sizes(strides)?);
        let same = shape.len() == strides.len();
        same.then_some(Stored { key: key.clone(), storage: kind.clone(), offset: size(&offset)?, shape, strides })
    }

    fn collect(&self, value: Value, prefix: &str, depth: usize, found: &mut Found) -> Result<(), Fault> {
        let Some(Node::Dict(pairs)) = self.node(value) else { return self.broken("it holds no dictionary of tensors") };
        for (key, value) in pairs {
            found.visited += 1;
            let Some(key) = self.text_of(*key) else { continue };
            if depth == MAX_DEPTH || found.visited > MAX_VALUES || prefix.len() + key.len() > MAX_NAME {
                return self.broken("its dictionaries are nested too deeply or hold too much");
            }
            let name = if prefix.is_empty() { key.to_owned() } else { format!("{prefix}.{key}") };
            match self.node(*value) {
                Some(Node::Tensor(tensor)) => {
                    found.tensors.insert(name, (**tensor).clone());
                }
                Some(Node::Dict(_)) => self.collect(*value, &name, depth + 1, found)?,
                _ => {}
            }
        }
        Ok(())
    }
}
