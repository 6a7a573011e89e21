//! The opcodes: decodes one after the other and moves the machine.

use super::{AllowList, Machine, Node, PickleError, Value};

/// The longest line of the text opcodes, in bytes.
const MAX_LINE: usize = 1 << 16;

impl<'a> Machine<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], PickleError> {
        let left = self.bytes.len() - self.at;
        if count > left {
            return Err(PickleError::Truncated { offset: self.bytes.len(), wanted: count - left });
        }
        let taken = &self.bytes[self.at..self.at + count];
        self.at += count;
        Ok(taken)
    }

    fn number<const N: usize>(&mut self) -> Result<[u8; N], PickleError> {
        let mut number = [0; N];
        number.copy_from_slice(self.take(N)?);
        Ok(number)
    }

    /// Reads a length of `size` bytes, little-endian.
    fn length(&mut self, size: usize) -> Result<usize, PickleError> {
        let mut number = [0; 8];
        number[..size].copy_from_slice(self.take(size)?);
        usize::try_from(u64::from_le_bytes(number)).map_err(|error| self.malformed(error.to_string()))
    }

    fn line(&mut self) -> Result<&'a str, PickleError> {
        let rest = &self.bytes[self.at..];
        let end = rest.iter().take(MAX_LINE).position(|byte| *byte == b'\n');
        let Some(end) = end else {
            return Err(PickleError::Truncated { offset: self.bytes.len(), wanted: 1 });
        };
        let line = std::str::from_utf8(&rest[..end]).map_err(|error| self.malformed(error.to_string()))?;
        self.at += end + 1;
        Ok(line.trim_end_matches('\r'))
    }

    fn blob(&mut self, size: usize) -> Result<(), PickleError> {
        let length = self.length(size)?;
        let bytes = self.take(length)?;
        self.charge(length)?;
        self.push_node(Node::Bytes(bytes.to_vec()))
    }

    fn text(&mut self, size: usize) -> Result<(), PickleError> {
        let length = self.length(size)?;
        let bytes = self.take(length)?;
        let text = std::str::from_utf8(bytes).map_err(|error| self.malformed(error.to_string()))?;
        self.push_node(Node::Text(text.to_owned()))
    }

    /// Old text strings: Python 2 wrote all its strings so; bytes beyond ASCII are read as Latin-1.
    fn old_text(&mut self, size: usize) -> Result<(), PickleError> {
        let length = self.length(size)?;
        let text: String = self.take(length)?.iter().map(|byte| char::from(*byte)).collect();
        self.push_node(Node::Text(text))
    }

    fn long(&mut self, length: usize) -> Result<(), PickleError> {
        let bytes = self.take(length)?;
        if length > 8 {
            return Err(self.malformed(format!("a whole number has {length} bytes, 8 are accepted")));
        }
        let negative = bytes.last().is_some_and(|byte| byte & 0x80 != 0);
        let mut number = if negative { [0xff; 8] } else { [0; 8] };
        number[..length].copy_from_slice(bytes);
        self.push(Value::Int(i64::from_le_bytes(number)))
    }

    fn parsed<T: std::str::FromStr>(&mut self) -> Result<T, PickleError> {
        let line = self.line()?;
        line.trim_end_matches('L').parse().map_err(|_| self.malformed(format!("{:?} is no number", short(line))))
    }

    /// Carries out one opcode; returns the root at the end.
    pub(super) fn step(&mut self) -> Result<Option<Value>, PickleError> {
        let offset = self.at;
        let opcode = self.take(1)?[0];
        match opcode {
            b'.' => return self.pop().map(Some),
            0x80 => {
                let [protocol] = self.number::<1>()?;
                if protocol > 5 {
                    return Err(self.malformed(format!("protocol is {protocol}, 0 to 5 are read")));
                }
            }
            0x95 => {
                self.length(8)?;
            }
            b'(' | b'0' | b'1' | b'2' => self.stack_opcode(opcode)?,
            b'N' | 0x88 | 0x89 | b'I' | b'J' | b'K' | b'L' | b'M' | b'F' | b'G' | 0x8a | 0x8b => {
                self.number_opcode(opcode)?
            }
            b'S' | b'T' | b'U' | b'V' | b'X' | b'B' | b'C' | 0x8c | 0x8d | 0x8e | 0x96 => self.text_opcode(opcode)?,
            b']' | b'l' | b'a' | b'e' | b'}' | b'd' | b's' | b'u' | b')' | b't' | 0x85..=0x87 | 0x8f..=0x91 => {
                self.container_opcode(opcode)?;
            }
            b'p' => {
                let index = self.parsed()?;
                self.remember(index)?;
            }
            b'q' | b'r' => {
                let index = self.length(if opcode == b'q' { 1 } else { 4 })?;
                self.remember(u32::try_from(index).unwrap_or(u32::MAX))?;
            }
            0x94 => {
                let index = u32::try_from(self.memo.len()).unwrap_or(u32::MAX);
                self.remember(index)?;
            }
            b'g' => {
                let index = self.parsed()?;
                self.recall(index)?;
            }
            b'h' | b'j' => {
                let index = self.length(if opcode == b'h' { 1 } else { 4 })?;
                self.recall(u32::try_from(index).unwrap_or(u32::MAX))?;
            }
            b'c' => {
                let (module, name) = (self.line()?, self.line()?);
                self.global(module, name, offset)?;
            }
            0x93 => {
                let names = self.pop_many(2)?;
                let name_of = |value: Value| self.text_of(value).map(str::to_owned);
                let (Some(module), Some(name)) = (name_of(names[0]), name_of(names[1])) else {
                    return Err(self.malformed("a global is named by something that is no text"));
                };
                self.global(&module, &name, offset)?;
            }
            b'R' | 0x81 => self.reduce()?,
            b'b' => self.build()?,
            b'Q' if self.allowed == AllowList::Tensors => self.persistent()?,
            _ => return Err(PickleError::Opcode { offset, opcode }),
        }
        Ok(None)
    }

    fn stack_opcode(&mut self, opcode: u8) -> Result<(), PickleError> {
        match opcode {
            b'(' => {
                self.charge(8)?;
                self.marks.push(self.stack.len());
            }
            b'0' => {
                self.pop()?;
            }
            b'1' => {
                self.pop_mark()?;
            }
            _ => {
                let top = self.top()?;
                self.push(top)?;
            }
        }
        Ok(())
    }

    fn number_opcode(&mut self, opcode: u8) -> Result<(), PickleError> {
        let value = match opcode {
            b'N' => Value::None,
            0x88 => Value::Bool(true),
            0x89 => Value::Bool(false),
            b'I' => {
                let line = self.line()?;
                match line {
                    "00" => Value::Bool(false),
                    "01" => Value::Bool(true),
                    _ => {
                        Value::Int(line.parse().map_err(|_| self.malformed(format!("{:?} is no number", short(line))))?)
                    }
                }
            }
            b'L' => Value::Int(self.parsed()?),
            b'F' => Value::Float(self.parsed()?),
            b'J' => Value::Int(i64::from(i32::from_le_bytes(self.number()?))),
            b'K' => Value::Int(i64::from(self.number::<1>()?[0])),
            b'M' => Value::Int(i64::from(u16::from_le_bytes(self.number()?))),
            b'G' => Value::Float(f64::from_be_bytes(self.number()?)),
            _ => {
                let length = self.length(if opcode == 0x8a { 1 } else { 4 })?;
                return self.long(length);
            }
        };
        self.push(value)
    }

    fn text_opcode(&mut self, opcode: u8) -> Result<(), PickleError> {
        match opcode {
            b'X' => self.text(4),
            0x8c => self.text(1),
            0x8d => self.text(8),
            b'B' => self.blob(4),
            b'C' => self.blob(1),
            0x8e | 0x96 => self.blob(8),
            b'T' => self.old_text(4),
            b'U' => self.old_text(1),
            b'S' => {
                let line = self.line()?;
                let quoted = ['\'', '"'].iter().find_map(|quote| line.strip_prefix(*quote)?.strip_suffix(*quote));
                let text = quoted.ok_or_else(|| self.malformed("a text has no quotes"))?;
                let text = unescape(text).ok_or_else(|| self.malformed("a text has a bad escape"))?;
                self.push_node(Node::Text(text))
            }
            _ => {
                let line = self.line()?;
                let text = unescape(line).ok_or_else(|| self.malformed("a text has a bad escape"))?;
                self.push_node(Node::Text(text))
            }
        }
    }

    fn container_opcode(&mut self, opcode: u8) -> Result<(), PickleError> {
        match opcode {
            b']' => self.push_node(Node::List(Vec::new())),
            b'}' => self.push_node(Node::Dict(Vec::new())),
            b')' => self.push_node(Node::Tuple(Vec::new())),
            0x8f => self.push_node(Node::Set(Vec::new())),
            b'l' => {
                let items = self.pop_mark()?;
                self.push_node(Node::List(items))
            }
            b't' => {
                let items = self.pop_mark()?;
                self.push_node(Node::Tuple(items))
            }
            0x85..=0x87 => {
                let items = self.pop_many(usize::from(opcode - 0x84))?;
                self.push_node(Node::Tuple(items))
            }
            0x91 => {
                let items = self.pop_mark()?;
                self.push_node(Node::Set(items))
            }
            b'd' => {
                let items = self.pop_mark()?;
                self.push_node(Node::Dict(Vec::new()))?;
                self.set_items(&items)
            }
            b'a' => {
                let items = self.pop_many(1)?;
                self.extend(items)
            }
            b'e' | 0x90 => {
                let items = self.pop_mark()?;
                self.extend(items)
            }
            b's' => {
                let items = self.pop_many(2)?;
                self.set_items(&items)
            }
            _ => {
                let items = self.pop_mark()?;
                self.set_items(&items)
            }
        }
    }
}

fn short(text: &str) -> String {
    text.chars().take(40).collect()
}

/// Resolves the escapes of the text opcodes: `\\`, quotes, `\n`, `\r`, `\t`, `\xhh`, `\uhhhh`, `\Uhhhhhhhh`.
fn unescape(text: &str) -> Option<String> {
    let mut out = String::with_capacity(text.len());
    let mut chars = text.chars();
    while let Some(c) = chars.next() {
        if c != '\\' {
            out.push(c);
            continue;
        }
        let digits = match chars.next()? {
            'n' => {
                out.push('\n');
                continue;
            }
            'r' => {
                out.push('\r');
                continue;
            }
            't' => {
                out.push('\t');
                continue;
            }
            'x' => 2,
            'u' => 4,
            'U' => 8,
            other => {
                out.push(other);
                continue;
            }
        };
        let code: String = chars.by_ref().take(digits).collect();
        out.push(char::from_u32(u32::from_str_radix(&code, 16).ok()?)?);
    }
    Some(out)
}
