//! Reads Python pickles (protocols 0 to 5) as data, without running anything in them.
//!
//! A small machine builds dicts, lists, tuples, text, numbers, NumPy arrays and the places of PyTorch's tensors in an
//! arena. Only names on one of two allow-lists may be called ([`AllowList`]), and calling them is done here, in Rust.
//! Values lie flat, so nesting costs no stack; memory is counted before it is taken and bounded; what is not understood is
//! refused with its byte offset.

use std::collections::BTreeMap;

mod array;
mod call;
mod names;
mod scan;
mod tensor;
#[cfg(test)]
mod tests;

pub use array::{Array, Data, Dtype};
pub use names::{AllowList, Callable};
pub use tensor::Tensor;

const NODE_BYTES: usize = 96;

/// Says why a pickle is refused; offsets are bytes from its start.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PickleError {
    /// The data ends in the middle of something.
    #[error("pickle ends at byte {offset}, {wanted} more bytes are needed")]
    Truncated {
        /// Where the data ends.
        offset: usize,
        /// How much is missing at least.
        wanted: usize,
    },
    /// It names something that is not on the allow-list; nothing was called.
    #[error("pickle wants \"{module}.{name}\" at byte {offset}, which is not on the allow-list; nothing was run")]
    Forbidden {
        /// Where.
        offset: usize,
        /// The module.
        module: String,
        /// The name in it.
        name: String,
    },
    /// An opcode that has no place in data.
    #[error("pickle has opcode {opcode:#04x} at byte {offset}, which is not accepted")]
    Opcode {
        /// Where.
        offset: usize,
        /// The opcode.
        opcode: u8,
    },
    /// The machine's rules are broken (empty stack, wrong kind of value, bad number).
    #[error("pickle is malformed at byte {offset}: {problem}")]
    Malformed {
        /// Where.
        offset: usize,
        /// What is wrong.
        problem: String,
    },
    /// An array's header does not fit its data, or its kind is not supported.
    #[error("pickle has a bad array at byte {offset}: {problem}")]
    Array {
        /// Where.
        offset: usize,
        /// What is wrong.
        problem: String,
    },
    /// The values would take too much memory.
    #[error("pickle needs more than {limit} bytes of memory at byte {offset}")]
    TooLarge {
        /// Where.
        offset: usize,
        /// The limit.
        limit: usize,
    },
    /// A value holds itself.
    #[error("pickle is cyclic: a {kind} holds itself")]
    Cyclic {
        /// The kind of the value.
        kind: &'static str,
    },
}

/// A value; what is large lies in the arena.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Value {
    /// Nothing.
    None,
    /// A truth value.
    Bool(bool),
    /// A whole number.
    Int(i64),
    /// A number.
    Float(f64),
    /// Index of a node.
    Node(usize),
    /// Something on the allow-list that may be called.
    Callable(Callable),
}

/// What lies in the arena.
#[derive(Debug, Clone, PartialEq)]
pub enum Node {
    /// Bytes.
    Bytes(Vec<u8>),
    /// A text.
    Text(String),
    /// A list.
    List(Vec<Value>),
    /// A tuple.
    Tuple(Vec<Value>),
    /// A set, in the order of the pickle.
    Set(Vec<Value>),
    /// A dict, in the order of the pickle; later entries of a key replace earlier ones.
    Dict(Vec<(Value, Value)>),
    /// The kind of an array's items.
    Dtype(Dtype),
    /// An array; none before its state is given.
    Array(Option<Array>),
    /// A storage of tensors' values.
    Storage {
        /// Name of its member in the archive.
        key: String,
        /// Its type.
        kind: &'static str,
    },
    /// A tensor.
    Tensor(Box<Tensor>),
}

impl Node {
    /// Returns the kind of value, as in messages.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Bytes(_) => "bytes",
            Self::Text(_) => "text",
            Self::List(_) => "list",
            Self::Tuple(_) => "tuple",
            Self::Set(_) => "set",
            Self::Dict(_) => "dict",
            Self::Dtype(_) => "dtype",
            Self::Array(_) => "array",
            Self::Storage { .. } => "storage",
            Self::Tensor(_) => "tensor",
        }
    }
}

/// A read pickle: the arena and the value at its root. No value holds itself.
#[derive(Debug)]
pub struct Pickle {
    /// The arena.
    pub nodes: Vec<Node>,
    /// The root.
    pub root: Value,
}

/// The machine that reads a pickle.
struct Machine<'a> {
    allowed: AllowList,
    bytes: &'a [u8],
    at: usize,
    stack: Vec<Value>,
    marks: Vec<usize>,
    memo: BTreeMap<u32, Value>,
    nodes: Vec<Node>,
    charged: usize,
}

/// Reads a pickle.
///
/// # Errors
/// If it is cut off or malformed, names what is not allowed, holds itself or takes more memory than its list allows.
pub fn read(bytes: &[u8], allowed: AllowList) -> Result<Pickle, PickleError> {
    let mut machine = Machine {
        allowed,
        bytes,
        at: 0,
        stack: Vec::new(),
        marks: Vec::new(),
        memo: BTreeMap::new(),
        nodes: Vec::new(),
        charged: 0,
    };
    let root = loop {
        if let Some(root) = machine.step()? {
            break root;
        }
    };
    let pickle = Pickle { nodes: machine.nodes, root };
    pickle.refuse_cycles()?;
    Ok(pickle)
}

impl Pickle {
    fn refuse_cycles(&self) -> Result<(), PickleError> {
        #[derive(Clone, Copy, PartialEq)]
        enum Mark {
            New,
            Open,
            Done,
        }
        let mut marks = vec![Mark::New; self.nodes.len()];
        let mut path: Vec<(usize, usize)> = Vec::new();
        for start in 0..self.nodes.len() {
            if marks[start] == Mark::New {
                marks[start] = Mark::Open;
                path.push((start, 0));
            }
            while let Some((node, next)) = path.last_mut() {
                match self.child(*node, *next) {
                    None => {
                        marks[*node] = Mark::Done;
                        path.pop();
                    }
                    Some(child) => {
                        *next += 1;
                        if let Value::Node(child) = child {
                            match marks[child] {
                                Mark::Open => return Err(PickleError::Cyclic { kind: self.nodes[child].kind() }),
                                Mark::New => {
                                    marks[child] = Mark::Open;
                                    path.push((child, 0));
                                }
                                Mark::Done => {}
                            }
                        }
                    }
                }
            }
        }
        Ok(())
    }

    /// Returns the value of an index inside a node, or `None` after the last.
    fn child(&self, node: usize, index: usize) -> Option<Value> {
        match &self.nodes[node] {
            Node::List(items) | Node::Tuple(items) | Node::Set(items) => items.get(index).copied(),
            Node::Dict(items) => {
                items.get(index / 2).map(|(key, value)| if index.is_multiple_of(2) { *key } else { *value })
            }
            Node::Array(Some(Array { data: Data::Objects(items), .. })) => items.get(index).copied(),
            _ => None,
        }
    }
}

impl Machine<'_> {
    fn malformed(&self, problem: impl Into<String>) -> PickleError {
        PickleError::Malformed { offset: self.at, problem: problem.into() }
    }

    /// Counts memory before it is taken.
    fn charge(&mut self, bytes: usize) -> Result<(), PickleError> {
        self.charged = self.charged.saturating_add(bytes);
        let limit = self.allowed.memory_bytes();
        if self.charged > limit {
            return Err(PickleError::TooLarge { offset: self.at, limit });
        }
        Ok(())
    }

    fn push(&mut self, value: Value) -> Result<(), PickleError> {
        self.charge(16)?;
        self.stack.push(value);
        Ok(())
    }

    fn push_node(&mut self, node: Node) -> Result<(), PickleError> {
        let value = self.node(node)?;
        self.push(value)
    }

    fn node(&mut self, node: Node) -> Result<Value, PickleError> {
        let inner = match &node {
            Node::Bytes(bytes) => bytes.len(),
            Node::Text(text) => text.len(),
            Node::List(items) | Node::Tuple(items) | Node::Set(items) => 16 * items.len(),
            Node::Dict(items) => 32 * items.len(),
            Node::Dtype(_) | Node::Array(_) => 0,
            Node::Storage { key, .. } => key.len(),
            Node::Tensor(tensor) => 128 + tensor.key.len() + 16 * tensor.shape.len(),
        };
        self.charge(NODE_BYTES + inner)?;
        self.nodes.push(node);
        Ok(Value::Node(self.nodes.len() - 1))
    }

    fn floor(&self) -> usize {
        self.marks.last().copied().unwrap_or(0)
    }

    fn pop(&mut self) -> Result<Value, PickleError> {
        if self.stack.len() <= self.floor() {
            return Err(self.malformed("the stack is empty"));
        }
        self.stack.pop().ok_or_else(|| self.malformed("the stack is empty"))
    }

    fn top(&self) -> Result<Value, PickleError> {
        if self.stack.len() <= self.floor() {
            return Err(self.malformed("the stack is empty"));
        }
        self.stack.last().copied().ok_or_else(|| self.malformed("the stack is empty"))
    }

    fn pop_mark(&mut self) -> Result<Vec<Value>, PickleError> {
        let mark = self.marks.pop().ok_or_else(|| self.malformed("there is no mark"))?;
        Ok(self.stack.split_off(mark))
    }

    fn pop_many(&mut self, count: usize) -> Result<Vec<Value>, PickleError> {
        if self.stack.len() < self.floor() + count {
            return Err(self.malformed("the stack is empty"));
        }
        Ok(self.stack.split_off(self.stack.len() - count))
    }

    /// Adds items to the list or set on top of the stack.
    fn extend(&mut self, items: Vec<Value>) -> Result<(), PickleError> {
        self.charge(16 * items.len())?;
        let Value::Node(target) = self.top()? else { return Err(self.malformed("items are added to no list")) };
        match &mut self.nodes[target] {
            Node::List(list) | Node::Set(list) => list.extend(items),
            other => {
                let kind = other.kind();
                return Err(self.malformed(format!("items are added to a {kind}")));
            }
        }
        Ok(())
    }

    /// Sets items of the dict on top of the stack.
    fn set_items(&mut self, items: &[Value]) -> Result<(), PickleError> {
        self.charge(32 * items.len())?;
        let Value::Node(target) = self.top()? else { return Err(self.malformed("items are set in no dict")) };
        if items.len() % 2 == 1 {
            return Err(self.malformed("a key has no value"));
        }
        match &mut self.nodes[target] {
            Node::Dict(dict) => dict.extend(items.chunks_exact(2).map(|pair| (pair[0], pair[1]))),
            other => {
                let kind = other.kind();
                return Err(self.malformed(format!("items are set in a {kind}")));
            }
        }
        Ok(())
    }

    fn remember(&mut self, index: u32) -> Result<(), PickleError> {
        self.charge(48)?;
        let value = self.top()?;
        self.memo.insert(index, value);
        Ok(())
    }

    fn recall(&mut self, index: u32) -> Result<(), PickleError> {
        let value = self.memo.get(&index).copied();
        let value = value.ok_or_else(|| self.malformed(format!("memo {index} is not set")))?;
        self.push(value)
    }

    fn text_of(&self, value: Value) -> Option<&str> {
        match value {
            Value::Node(node) => match &self.nodes[node] {
                Node::Text(text) => Some(text),
                _ => None,
            },
            _ => None,
        }
    }
}
