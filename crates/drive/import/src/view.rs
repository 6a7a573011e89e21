//! Typed access to the values of a pickle; every refusal names the field, as `tracks["ego"].state.position[3]`.

use ds_pickle::{Array, Data, Node, Pickle, Value};
use ds_space::DVec2;

/// Farthest coordinate of any source, in metres: beyond those of any map projection.
pub(crate) const FARTHEST_M: f64 = 1e8;

/// A value of a pickle and the path to it.
#[derive(Debug, Clone)]
pub(crate) struct View<'a> {
    pickle: &'a Pickle,
    value: Value,
    at: String,
}

/// What is wrong with a field.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FieldFault {
    pub at: String,
    pub problem: String,
}

/// Rows of numbers: `values` holds `rows` × `columns` in row-major order.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Table {
    pub rows: usize,
    pub columns: usize,
    pub values: Vec<f64>,
}

impl Table {
    pub(crate) fn get(&self, row: usize, column: usize) -> f64 {
        self.values[row * self.columns + column]
    }
}

impl<'a> View<'a> {
    pub(crate) fn root(pickle: &'a Pickle) -> Self {
        Self { pickle, value: pickle.root, at: String::new() }
    }

    pub(crate) fn at(&self) -> &str {
        &self.at
    }

    pub(crate) fn fault(&self, problem: impl Into<String>) -> FieldFault {
        FieldFault { at: self.at.clone(), problem: problem.into() }
    }

    fn node(&self) -> Option<&'a Node> {
        match self.value {
            Value::Node(node) => self.pickle.nodes.get(node),
            _ => None,
        }
    }

    fn kind(&self) -> &'static str {
        match self.value {
            Value::None => "None",
            Value::Bool(_) => "bool",
            Value::Int(_) => "int",
            Value::Float(_) => "float",
            Value::Callable(_) => "type",
            Value::Node(node) => self.pickle.nodes[node].kind(),
        }
    }

    fn with(&self, value: Value, step: &str) -> Self {
        Self { pickle: self.pickle, value, at: format!("{}{step}", self.at) }
    }

    /// Returns the value of a key, if this is a dict that has it and it is not None.
    pub(crate) fn get(&self, key: &str) -> Option<Self> {
        let Some(Node::Dict(items)) = self.node() else { return None };
        let is_key = |value: &Value| matches!(value, Value::Node(node) if matches!(&self.pickle.nodes[*node], Node::Text(text) if text == key));
        let (_, value) = items.iter().rev().find(|(found, _)| is_key(found))?;
        let step = if self.at.is_empty() { key.to_owned() } else { format!(".{key}") };
        (*value != Value::None).then(|| self.with(*value, &step))
    }

    pub(crate) fn need(&self, key: &str) -> Result<Self, FieldFault> {
        if !matches!(self.node(), Some(Node::Dict(_))) {
            return Err(self.fault(format!("is a {}, not a dict", self.kind())));
        }
        self.get(key).ok_or_else(|| self.fault(format!("has no {key:?}")))
    }

    /// Returns the entries of a dict, in file order, keys as text.
    pub(crate) fn entries(&self) -> Result<Vec<(String, Self)>, FieldFault> {
        let Some(Node::Dict(items)) = self.node() else {
            return Err(self.fault(format!("is a {}, not a dict", self.kind())));
        };
        items
            .iter()
            .map(|(key, value)| {
                let name = self.with(*key, "").text().ok_or_else(|| self.fault("has a key that is no text"))?;
                let step = format!("[{:?}]", name.chars().take(48).collect::<String>());
                Ok((name, self.with(*value, &step)))
            })
            .collect()
    }

    /// Returns text; numbers are written out.
    pub(crate) fn text(&self) -> Option<String> {
        match (self.value, self.node()) {
            (Value::Int(number), _) => Some(number.to_string()),
            (Value::Float(number), _) => Some(number.to_string()),
            (_, Some(Node::Text(text))) => Some(text.clone()),
            (_, Some(Node::Bytes(bytes))) => String::from_utf8(bytes.clone()).ok(),
            _ => None,
        }
    }

    /// Returns a number, also from an array or list of one item.
    pub(crate) fn number(&self) -> Option<f64> {
        match (self.value, self.node()) {
            (Value::Bool(value), _) => Some(f64::from(u8::from(value))),
            (Value::Int(value), _) => Some(value as f64),
            (Value::Float(value), _) => Some(value),
            (_, Some(Node::Array(Some(Array { data: Data::Numbers(numbers), .. })))) => numbers.first().copied(),
            (_, Some(Node::List(items) | Node::Tuple(items))) => self.with(*items.first()?, "").scalar(),
            _ => None,
        }
    }

    fn scalar(&self) -> Option<f64> {
        match self.value {
            Value::Bool(value) => Some(f64::from(u8::from(value))),
            Value::Int(value) => Some(value as f64),
            Value::Float(value) => Some(value),
            _ => None,
        }
    }

    /// Returns the items of a list, tuple, set or array of objects; nothing of anything else.
    pub(crate) fn items(&self) -> Vec<Self> {
        let items = match self.node() {
            Some(Node::List(items) | Node::Tuple(items) | Node::Set(items)) => items,
            Some(Node::Array(Some(Array { data: Data::Objects(items), .. }))) => items,
            _ => return Vec::new(),
        };
        items.iter().enumerate().map(|(i, item)| self.with(*item, &format!("[{i}]"))).collect()
    }

    /// Returns texts of a list or array; None and the like become empty.
    pub(crate) fn texts(&self) -> Vec<String> {
        match self.node() {
            Some(Node::Array(Some(Array { data: Data::Texts(texts), .. }))) => texts.clone(),
            Some(Node::Array(Some(Array { data: Data::Numbers(numbers), .. }))) => {
                numbers.iter().map(f64::to_string).collect()
            }
            _ => self.items().iter().map(|item| item.text().unwrap_or_default()).collect(),
        }
    }

    /// Returns rows of numbers from an array, a list of numbers or a list of rows; plain lists are one column.
    pub(crate) fn table(&self) -> Result<Table, FieldFault> {
        match self.node() {
            Some(Node::Array(Some(Array { shape, data: Data::Numbers(numbers) }))) => {
                let rows = if numbers.is_empty() { 0 } else { shape.first().copied().unwrap_or(1) };
                let columns = numbers.len().checked_div(rows).unwrap_or(1);
                Ok(Table { rows, columns, values: numbers.clone() })
            }
            Some(Node::List(items) | Node::Tuple(items)) => {
                let mut table = Table { rows: items.len(), columns: 1, values: Vec::new() };
                for (i, item) in items.iter().enumerate() {
                    let item = self.with(*item, &format!("[{i}]"));
                    let row = item.row()?;
                    if i == 0 {
                        table.columns = row.len();
                    } else if row.len() != table.columns {
                        return Err(item.fault(format!(
                            "has {} numbers, the first row has {}",
                            row.len(),
                            table.columns
                        )));
                    }
                    table.values.extend(row);
                }
                Ok(table)
            }
            Some(Node::Array(Some(Array { shape, data: Data::Objects(_) }))) if shape.first() == Some(&0) => {
                Ok(Table { rows: 0, columns: 1, values: Vec::new() })
            }
            _ => Err(self.fault(format!("is a {}, not an array of numbers", self.kind()))),
        }
    }

    fn row(&self) -> Result<Vec<f64>, FieldFault> {
        if let Some(number) = self.scalar() {
            return Ok(vec![number]);
        }
        match self.node() {
            Some(Node::Array(Some(Array { data: Data::Numbers(numbers), .. }))) => Ok(numbers.clone()),
            Some(Node::List(items) | Node::Tuple(items)) => {
                let number =
                    |item: &Value| self.with(*item, "").scalar().ok_or_else(|| self.fault("holds what is no number"));
                items.iter().map(number).collect()
            }
            _ => Err(self.fault(format!("is a {}, not a number or row", self.kind()))),
        }
    }

    /// Returns x and y of rows of at least two numbers; all must lie within [`FARTHEST_M`] of the origin.
    pub(crate) fn points(&self) -> Result<Vec<DVec2>, FieldFault> {
        let table = self.table()?;
        if table.rows > 0 && table.columns < 2 {
            return Err(self.fault("has rows of less than 2 numbers"));
        }
        (0..table.rows)
            .map(|row| {
                let point = DVec2::new(table.get(row, 0), table.get(row, 1));
                let near = point.abs().max_element() <= FARTHEST_M;
                if near { Ok(point) } else { Err(self.fault(format!("[{row}] is {point}, no place on a map"))) }
            })
            .collect()
    }
}
