//! What the names on the allow-lists do: rebuild arrays, dtypes and numbers, make containers. All of it is data.

use super::array::{Array, Data, Dtype};
use super::{Callable, Machine, Node, PickleError, Value};

impl Machine<'_> {
    pub(super) fn global(&mut self, module: &str, name: &str, offset: usize) -> Result<(), PickleError> {
        let short = |text: &str| text.chars().take(80).collect();
        match self.allowed.callable(module, name) {
            Some(callable) => self.push(Value::Callable(callable)),
            None => Err(PickleError::Forbidden { offset, module: short(module), name: short(name) }),
        }
    }

    fn items_of(&self, value: Value) -> Option<Vec<Value>> {
        let Value::Node(node) = value else { return None };
        match &self.nodes[node] {
            Node::List(items) | Node::Tuple(items) | Node::Set(items) => Some(items.clone()),
            _ => None,
        }
    }

    fn array_error(&self, problem: impl Into<String>) -> PickleError {
        PickleError::Array { offset: self.at, problem: problem.into() }
    }

    /// Carries out `callable(*arguments)` for the allow-list.
    pub(super) fn reduce(&mut self) -> Result<(), PickleError> {
        let pair = self.pop_many(2)?;
        let Value::Callable(callable) = pair[0] else {
            return Err(self.malformed("something is called that is no function"));
        };
        let Some(arguments) = self.items_of(pair[1]) else { return Err(self.malformed("arguments are no tuple")) };
        self.charge(16 * arguments.len())?;
        match callable {
            Callable::Reconstruct | Callable::NdArray => self.push_node(Node::Array(None)),
            Callable::FromBuffer => self.buffer_array(&arguments),
            Callable::Scalar => self.scalar(&arguments),
            Callable::Dtype => {
                let code = arguments.first().and_then(|code| self.text_of(*code)).map(str::to_owned);
                let dtype = code.as_deref().and_then(Dtype::parse);
                let dtype = dtype.ok_or_else(|| {
                    self.array_error(format!("dtype {:?} is not supported", code.unwrap_or_default()))
                })?;
                self.push_node(Node::Dtype(dtype))
            }
            Callable::Encode => self.encode(&arguments),
            Callable::Dict => self.dict(&arguments),
            Callable::List | Callable::Tuple | Callable::Set => {
                let items = match arguments.first() {
                    None => Vec::new(),
                    Some(value) => {
                        self.items_of(*value).ok_or_else(|| self.malformed("a container is made of no list"))?
                    }
                };
                self.push_node(match callable {
                    Callable::List => Node::List(items),
                    Callable::Tuple => Node::Tuple(items),
                    _ => Node::Set(items),
                })
            }
            Callable::Bytes => {
                if arguments.is_empty() {
                    self.push_node(Node::Bytes(Vec::new()))
                } else {
                    self.encode(&arguments)
                }
            }
            Callable::Path => {
                let parts: Vec<&str> = arguments.iter().filter_map(|part| self.text_of(*part)).collect();
                let text = parts.join("/");
                self.push_node(Node::Text(text))
            }
            Callable::Size | Callable::Parameter => match arguments.first() {
                Some(value) => self.push(*value),
                None => Err(self.malformed("a call has no argument")),
            },
            Callable::Tensor => self.tensor(&arguments),
            Callable::Inert | Callable::Storage(_) => Err(self.malformed("a plain type is called")),
        }
    }

    fn dict(&mut self, arguments: &[Value]) -> Result<(), PickleError> {
        let mut items = Vec::new();
        match arguments.first() {
            None | Some(Value::Callable(_) | Value::None) => {}
            Some(pairs) => {
                let pairs = self.items_of(*pairs).ok_or_else(|| self.malformed("a dict is made of no list"))?;
                for pair in pairs {
                    match self.items_of(pair).as_deref() {
                        Some([key, value]) => items.push((*key, *value)),
                        _ => return Err(self.malformed("a dict is made of what is no pair")),
                    }
                }
            }
        }
        self.push_node(Node::Dict(items))
    }

    /// `_codecs.encode(text, "latin1")`: how old protocols write bytes.
    fn encode(&mut self, arguments: &[Value]) -> Result<(), PickleError> {
        let encoding = arguments.get(1).and_then(|encoding| self.text_of(*encoding)).unwrap_or("utf-8");
        let latin = matches!(encoding, "latin1" | "latin-1" | "iso-8859-1");
        if !latin && !matches!(encoding, "utf-8" | "utf8" | "ascii") {
            return Err(self.malformed(format!("encoding {encoding:?} is not known")));
        }
        let text = arguments.first().and_then(|text| self.text_of(*text));
        let text = text.ok_or_else(|| self.malformed("what is encoded is no text"))?;
        let bytes = if latin {
            text.chars().map(|c| u8::try_from(u32::from(c)).ok()).collect()
        } else {
            Some(text.as_bytes().to_vec())
        };
        let bytes = bytes.ok_or_else(|| self.malformed("a character is beyond Latin-1"))?;
        self.push_node(Node::Bytes(bytes))
    }

    fn dtype_of(&self, value: Option<&Value>) -> Result<Dtype, PickleError> {
        if let Some(Value::Node(node)) = value
            && let Node::Dtype(dtype) = &self.nodes[*node]
        {
            return Ok(*dtype);
        }
        Err(self.array_error("there is no dtype"))
    }

    fn shape_of(&self, value: Option<&Value>) -> Result<Vec<usize>, PickleError> {
        let items =
            value.and_then(|value| self.items_of(*value)).ok_or_else(|| self.array_error("the shape is no tuple"))?;
        if items.len() > 8 {
            return Err(self.array_error(format!("the array has {} dimensions", items.len())));
        }
        let size = |item: &Value| match item {
            Value::Int(size) => usize::try_from(*size).ok(),
            _ => None,
        };
        items.iter().map(|item| size(item).ok_or_else(|| self.array_error("a dimension is no size"))).collect()
    }

    /// Makes an array of its parts after checking that the header fits the data.
    fn array(&mut self, shape: Vec<usize>, dtype: Dtype, fortran: bool, data: Value) -> Result<Array, PickleError> {
        let count = shape.iter().try_fold(1usize, |count, size| count.checked_mul(*size));
        let shape_text = format!("{shape:?}");
        let Some(count) = count else { return Err(self.array_error(format!("shape {shape_text} overflows"))) };
        if dtype == Dtype::Object {
            let items = self.items_of(data).filter(|items| items.len() == count);
            let items = items
                .ok_or_else(|| self.array_error(format!("shape {shape_text} does not fit the list of objects")))?;
            return Ok(Array { shape, data: Data::Objects(items) });
        }
        let needed = count.saturating_mul(dtype.item_bytes());
        let Value::Node(node) = data else { return Err(self.array_error("the data are no bytes")) };
        let given = match &self.nodes[node] {
            Node::Bytes(bytes) => bytes.len(),
            Node::Text(text) => text.chars().count(),
            _ => return Err(self.array_error("the data are no bytes")),
        };
        if given != needed {
            return Err(self.array_error(format!("shape {shape_text} needs {needed} bytes, {given} are given")));
        }
        self.charge(count.saturating_mul(if dtype.is_text() { 32 + 4 * dtype.item_bytes() } else { 8 }))?;
        let bytes = match &self.nodes[node] {
            Node::Bytes(bytes) => bytes.clone(),
            Node::Text(text) => text.chars().map(|c| u8::try_from(u32::from(c)).unwrap_or(b'?')).collect(),
            _ => Vec::new(),
        };
        let data = if dtype.item_bytes() == 0 { Data::Texts(vec![String::new(); count]) } else { dtype.decode(&bytes) };
        let mut array = Array { shape, data };
        if fortran {
            array.reorder_by_rows();
        }
        Ok(array)
    }

    fn buffer_array(&mut self, arguments: &[Value]) -> Result<(), PickleError> {
        let (dtype, shape) = (self.dtype_of(arguments.get(1))?, self.shape_of(arguments.get(2))?);
        let fortran = arguments.get(3).and_then(|order| self.text_of(*order)) == Some("F");
        let data = arguments.first().copied().unwrap_or(Value::None);
        let array = self.array(shape, dtype, fortran, data)?;
        self.push_node(Node::Array(Some(array)))
    }

    fn scalar(&mut self, arguments: &[Value]) -> Result<(), PickleError> {
        let dtype = self.dtype_of(arguments.first())?;
        let array = self.array(Vec::new(), dtype, false, arguments.get(1).copied().unwrap_or(Value::None))?;
        match array.data {
            Data::Numbers(numbers) => self.push(match dtype {
                Dtype::Bool => Value::Bool(numbers[0] != 0.0),
                _ => Value::Float(numbers[0]),
            }),
            Data::Texts(mut texts) => self.push_node(Node::Text(texts.swap_remove(0))),
            Data::Objects(items) => self.push(items[0]),
        }
    }

    /// Carries out `object.__setstate__(state)` for arrays and dtypes.
    pub(super) fn build(&mut self) -> Result<(), PickleError> {
        let state = self.pop()?;
        let Value::Node(target) = self.top()? else { return Err(self.malformed("a state is given to no object")) };
        let parts = self.items_of(state);
        match (&self.nodes[target], parts) {
            (Node::Dtype(dtype), Some(parts)) => {
                if parts.get(3).is_some_and(|names| *names != Value::None) {
                    return Err(self.array_error("structured dtypes are not supported"));
                }
                let dtype = *dtype;
                let order = parts.get(1).and_then(|order| self.text_of(*order)).unwrap_or("|");
                self.nodes[target] = Node::Dtype(dtype.ordered(order));
                Ok(())
            }
            (Node::Array(None), Some(parts)) if parts.len() == 5 => {
                let (shape, dtype) = (self.shape_of(parts.get(1))?, self.dtype_of(parts.get(2))?);
                let fortran = matches!(parts[3], Value::Bool(true) | Value::Int(1));
                let array = self.array(shape, dtype, fortran, parts[4])?;
                self.nodes[target] = Node::Array(Some(array));
                Ok(())
            }
            // The state of a dictionary of tensors is the version table of its modules.
            (Node::Dict(_), None) | (Node::Tensor(_), _) => Ok(()),
            (node, _) => {
                let kind = node.kind();
                Err(self.malformed(format!("a state is given to a {kind}")))
            }
        }
    }
}
