//! PyTorch's tensors: where their values lie in storages that the pickle only names.

use super::{Callable, Machine, Node, PickleError, Value};

const MAX_AXES: usize = 8;

/// A tensor: where its values lie in a storage.
#[derive(Debug, Clone, PartialEq)]
pub struct Tensor {
    /// Name of the storage's member in the archive.
    pub key: String,
    /// Type of the storage, such as `BFloat16Storage`.
    pub storage: &'static str,
    /// First value.
    pub offset: usize,
    /// Extent of each axis.
    pub shape: Vec<usize>,
    /// Values from one index to the next, for each axis.
    pub strides: Vec<usize>,
}

impl Machine<'_> {
    /// Resolves ("storage", type, key, device, count).
    pub(super) fn persistent(&mut self) -> Result<(), PickleError> {
        let id = self.pop()?;
        let parts = self.tuple_of(id).and_then(|parts| {
            let [kind, Value::Callable(Callable::Storage(storage)), key, ..] = parts else { return None };
            (self.text_of(*kind)? == "storage").then_some((self.text_of(*key)?.to_owned(), *storage))
        });
        let (key, kind) = parts.ok_or_else(|| self.malformed("a persistent value is no storage"))?;
        self.push_node(Node::Storage { key, kind })
    }

    /// Makes a tensor of (storage, offset, shape, strides, ...).
    pub(super) fn tensor(&mut self, arguments: &[Value]) -> Result<(), PickleError> {
        let tensor = match arguments {
            [storage, offset, shape, strides, ..] => self.described(*storage, *offset, *shape, *strides),
            _ => None,
        };
        let tensor = tensor.ok_or_else(|| self.malformed("a tensor is described wrongly"))?;
        self.push_node(Node::Tensor(Box::new(tensor)))
    }

    fn described(&self, storage: Value, offset: Value, shape: Value, strides: Value) -> Option<Tensor> {
        let Value::Node(storage) = storage else { return None };
        let Node::Storage { key, kind } = &self.nodes[storage] else { return None };
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
        same.then_some(Tensor { key: key.clone(), storage: kind, offset: size(&offset)?, shape, strides })
    }

    fn tuple_of(&self, value: Value) -> Option<&[Value]> {
        match value {
            Value::Node(node) => match &self.nodes[node] {
                Node::Tuple(values) => Some(values),
                _ => None,
            },
            _ => None,
        }
    }
}
