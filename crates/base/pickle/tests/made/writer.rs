//! Writes pickles of protocol 4 for tests.

/// A pickle under way.
pub(crate) struct Writer(Vec<u8>);

impl Writer {
    pub(crate) fn new() -> Self {
        Self(vec![0x80, 4])
    }

    pub(crate) fn text(&mut self, text: &str) -> &mut Self {
        self.0.push(b'X');
        self.0.extend((text.len() as u32).to_le_bytes());
        self.0.extend(text.as_bytes());
        self
    }

    pub(crate) fn int(&mut self, value: i32) -> &mut Self {
        self.0.push(b'J');
        self.0.extend(value.to_le_bytes());
        self
    }

    pub(crate) fn float(&mut self, value: f64) -> &mut Self {
        self.0.push(b'G');
        self.0.extend(value.to_be_bytes());
        self
    }

    pub(crate) fn none(&mut self) -> &mut Self {
        self.0.push(b'N');
        self
    }

    pub(crate) fn dict(&mut self, fill: impl FnOnce(&mut Self)) -> &mut Self {
        self.0.extend(b"}(");
        fill(self);
        self.0.push(b'u');
        self
    }

    pub(crate) fn list(&mut self, fill: impl FnOnce(&mut Self)) -> &mut Self {
        self.0.extend(b"](");
        fill(self);
        self.0.push(b'e');
        self
    }

    /// An array as NumPy writes it, little-endian f8.
    pub(crate) fn array(&mut self, shape: &[i32], values: &[f64]) -> &mut Self {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.array_of(shape, "f8", &bytes)
    }

    pub(crate) fn array_of(&mut self, shape: &[i32], dtype: &str, bytes: &[u8]) -> &mut Self {
        self.0.extend(b"cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\0\x85C\x01b\x87R(K\x01(");
        for size in shape {
            self.int(*size);
        }
        self.0.extend(b"tcnumpy\ndtype\n");
        self.text(dtype);
        self.0.extend(b"\x89\x88\x87R(K\x03X\x01\0\0\0<NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\0tb\x89B");
        self.0.extend((bytes.len() as u32).to_le_bytes());
        self.0.extend(bytes);
        self.0.extend(b"tb");
        self
    }

    pub(crate) fn done(&mut self) -> Vec<u8> {
        self.0.push(b'.');
        std::mem::take(&mut self.0)
    }
}
