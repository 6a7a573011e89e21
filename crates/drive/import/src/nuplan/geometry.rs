//! Geometries of a GeoPackage: the `GP` header and the well-known binary after it, as points in the file's own units.
//!
//! Bytes from outside: every count is checked against the bytes that are left before anything is allocated, nothing
//! recurses, and what is damaged is refused with its offset. Heights and measures are read over. Holes are counted, not
//! kept: areas of a map are simple polygons.

use ds_space::DVec2;

/// The most points of one geometry.
const MOST_POINTS: usize = 100_000;

/// Says why a geometry is refused; offsets are bytes from its start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum GeometryError {
    /// The data ends in the middle of something.
    #[error("geometry ends at byte {offset}, {wanted} more bytes are needed")]
    Truncated {
        /// Where the data ends.
        offset: usize,
        /// How much is missing at least.
        wanted: usize,
    },
    /// The header is not that of a geometry of a GeoPackage.
    #[error("geometry header {problem}")]
    Header {
        /// What is wrong.
        problem: &'static str,
    },
    /// A byte order is neither 0 nor 1.
    #[error("geometry has byte order {found} at byte {offset}, not 0 or 1")]
    ByteOrder {
        /// Where.
        offset: usize,
        /// What stands there.
        found: u8,
    },
    /// A kind of geometry that has no place here.
    #[error("geometry has kind {found} at byte {offset}, which is not accepted there")]
    Kind {
        /// Where.
        offset: usize,
        /// The code of the kind.
        found: u32,
    },
    /// A coordinate is no number.
    #[error("geometry has a coordinate that is not finite at byte {offset}")]
    NotFinite {
        /// Where the point begins.
        offset: usize,
    },
    /// There are too many points.
    #[error("geometry has more than {limit} points at byte {offset}")]
    TooLarge {
        /// Where.
        offset: usize,
        /// The limit.
        limit: usize,
    },
}

/// A geometry, its parts in file order.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Geometry {
    pub points: Vec<DVec2>,
    pub lines: Vec<Vec<DVec2>>,
    /// Outer rings, as in the file: the last point repeats the first.
    pub rings: Vec<Vec<DVec2>>,
    pub holes: usize,
}

impl Geometry {
    /// Returns all points.
    pub(super) fn all(&self) -> impl Iterator<Item = &DVec2> {
        self.points.iter().chain(self.lines.iter().flatten()).chain(self.rings.iter().flatten())
    }

    pub(super) fn all_mut(&mut self) -> impl Iterator<Item = &mut DVec2> {
        self.points.iter_mut().chain(self.lines.iter_mut().flatten()).chain(self.rings.iter_mut().flatten())
    }
}

const POINT: u32 = 1;
const LINE: u32 = 2;
const POLYGON: u32 = 3;
/// The kinds of several points, lines and polygons are 3 more than those of one.
const SEVERAL: u32 = 3;

/// Reads a geometry.
pub(super) fn read(blob: &[u8]) -> Result<Geometry, GeometryError> {
    let mut reader = Reader { bytes: blob, at: 0, little: true, points: 0 };
    let mut geometry = Geometry::default();
    if reader.header()? {
        return Ok(geometry);
    }
    let offset = reader.at;
    let (kind, extra) = reader.kind()?;
    match kind {
        POINT..=POLYGON => reader.part(kind, extra, &mut geometry)?,
        _ if (POINT + SEVERAL..=POLYGON + SEVERAL).contains(&kind) => {
            // A part has a byte order, a kind and a count or a point.
            for _ in 0..reader.count(9)? {
                let offset = reader.at;
                let (part, extra) = reader.kind()?;
                if part + SEVERAL != kind {
                    return Err(GeometryError::Kind { offset, found: part });
                }
                reader.part(part, extra, &mut geometry)?;
            }
        }
        found => return Err(GeometryError::Kind { offset, found }),
    }
    Ok(geometry)
}

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
    little: bool,
    points: usize,
}

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], GeometryError> {
        let left = self.bytes.len() - self.at;
        let found = self.bytes.get(self.at..self.at + N).and_then(|bytes| bytes.try_into().ok());
        let found = found.ok_or(GeometryError::Truncated { offset: self.bytes.len(), wanted: N - left.min(N) })?;
        self.at += N;
        Ok(found)
    }

    fn number(&mut self) -> Result<u32, GeometryError> {
        let bytes = self.take()?;
        Ok(if self.little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) })
    }

    fn real(&mut self) -> Result<f64, GeometryError> {
        let bytes = self.take()?;
        Ok(if self.little { f64::from_le_bytes(bytes) } else { f64::from_be_bytes(bytes) })
    }

    /// Reads a count of things that take at least so many bytes each.
    fn count(&mut self, each: usize) -> Result<usize, GeometryError> {
        let count = self.number()? as usize;
        let left = self.bytes.len() - self.at;
        if count > left / each {
            let wanted = count.saturating_mul(each).saturating_sub(left);
            return Err(GeometryError::Truncated { offset: self.bytes.len(), wanted });
        }
        Ok(count)
    }

    /// Reads the header; true for an empty geometry.
    fn header(&mut self) -> Result<bool, GeometryError> {
        let [g, p, version, flags] = self.take()?;
        let refuse = |problem| Err(GeometryError::Header { problem });
        if [g, p] != *b"GP" {
            return refuse("does not begin with GP");
        }
        if version != 0 {
            return refuse("is of an unknown version");
        }
        if flags & 0b0010_0000 != 0 {
            return refuse("announces an extended geometry");
        }
        let envelope = match (flags >> 1) & 0b111 {
            0 => 0,
            1 => 4,
            2 | 3 => 6,
            4 => 8,
            _ => return refuse("has an unknown envelope"),
        };
        self.little = flags & 1 == 1;
        self.number()?;
        for _ in 0..envelope {
            self.real()?;
        }
        Ok(flags & 0b0001_0000 != 0)
    }

    /// Reads byte order and kind; returns the kind without its extra dimensions, and their number.
    fn kind(&mut self) -> Result<(u32, usize), GeometryError> {
        let offset = self.at;
        let [order] = self.take()?;
        if order > 1 {
            return Err(GeometryError::ByteOrder { offset, found: order });
        }
        self.little = order == 1;
        let code = self.number()?;
        // Extra dimensions as thousands (ISO) or as high bits (EWKB, whose third bit is a reference system).
        let (flags, plain) = (code >> 29, code & 0x1fff_ffff);
        let thousands = plain / 1_000;
        if thousands > 3 || (flags != 0 && thousands != 0) {
            return Err(GeometryError::Kind { offset, found: code });
        }
        if flags & 1 == 1 {
            self.number()?;
        }
        let extra = match thousands {
            0 => ((flags >> 1) & 1) + ((flags >> 2) & 1),
            3 => 2,
            _ => 1,
        };
        Ok((plain % 1_000, extra as usize))
    }

    fn part(&mut self, kind: u32, extra: usize, into: &mut Geometry) -> Result<(), GeometryError> {
        match kind {
            POINT => {
                let point = self.point(extra)?;
                into.points.push(point);
            }
            LINE => into.lines.push(self.line(extra)?),
            _ => {
                for i in 0..self.count(4)? {
                    let ring = self.line(extra)?;
                    if i == 0 {
                        into.rings.push(ring);
                    } else {
                        into.holes += 1;
                    }
                }
            }
        }
        Ok(())
    }

    fn line(&mut self, extra: usize) -> Result<Vec<DVec2>, GeometryError> {
        let offset = self.at;
        let count = self.count(8 * (2 + extra))?;
        self.points += count;
        if self.points > MOST_POINTS {
            return Err(GeometryError::TooLarge { offset, limit: MOST_POINTS });
        }
        (0..count).map(|_| self.point(extra)).collect()
    }

    fn point(&mut self, extra: usize) -> Result<DVec2, GeometryError> {
        let offset = self.at;
        let point = DVec2::new(self.real()?, self.real()?);
        for _ in 0..extra {
            self.real()?;
        }
        if point.is_finite() { Ok(point) } else { Err(GeometryError::NotFinite { offset }) }
    }
}

#[cfg(test)]
mod tests;
