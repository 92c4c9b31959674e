//! Reads the parameter section: named groups of named values.
//!
//! A group consists of `length, -id, name, next`, a parameter of `length, id, name, next, type, dimensions, values`.
//! `next` is the distance from its own position to the following record, and 0 in the last record.

/// Maximum length of a list, because each dimension of a parameter is stored in one byte.
const MAX_LIST: usize = 255;

/// Groups and parameters of a C3D file, not yet decoded.
pub(super) struct Parameters<'f> {
    pub order: ByteOrder,
    groups: Vec<(u8, &'f [u8])>,
    parameters: Vec<Parameter<'f>>,
}

struct Parameter<'f> {
    group: u8,
    name: &'f [u8],
    /// Type of the values: the number of bytes per value, or -1 for text.
    kind: i8,
    /// First dimension, which for text is the length of each string; 1 for a single value.
    width: usize,
    values: &'f [u8],
}

impl<'f> Parameters<'f> {
    /// Reads the groups and parameters in a section of `length` bytes (0 if unknown); zeros may follow the last record.
    /// Returns `None` if a record extends beyond the bytes of the file.
    pub(super) fn read(section: &'f [u8], length: usize, order: ByteOrder) -> Option<Self> {
        let mut read = Self { order, groups: Vec::new(), parameters: Vec::new() };
        let mut at = 4;
        while at < length || length == 0 {
            let [name_length, id] = bytes_at::<2>(section, at)?.map(u8::cast_signed);
            if name_length == 0 {
                break;
            }
            let name_end = at + 2 + usize::from(name_length.unsigned_abs());
            let name = section.get(at + 2..name_end)?;
            let next = usize::from(order.u16(bytes_at(section, name_end)?));
            let mut end = name_end + 2;
            if id < 0 {
                read.groups.push((id.unsigned_abs(), name));
            } else {
                let (parameter, bytes) = parameter(id.unsigned_abs(), name, section.get(end..)?)?;
                read.parameters.push(parameter);
                end += bytes;
            }
            if next == 0 {
                break;
            }
            at = name_end + next;
            if at > length && length > 0 {
                // Some programs leave an arbitrary value in the last record. A record ends with its description.
                at = end + 1 + section.get(end).map_or(0, |&bytes| usize::from(bytes));
            }
        }
        Some(read)
    }

    fn find(&self, group: &str, name: &str) -> Option<&Parameter<'f>> {
        let (id, _) =
            self.groups.iter().find(|(_, found)| found.eq_ignore_ascii_case(group.as_bytes()))?;
        self.parameters.iter().find(|parameter| {
            parameter.group == *id && parameter.name.eq_ignore_ascii_case(name.as_bytes())
        })
    }

    /// Returns the numbers in a parameter; `None` if there is no such numeric parameter. Bytes and integers are read as
    /// unsigned, because large counts are stored in this way.
    pub(super) fn numbers(&self, group: &str, name: &str) -> Option<Vec<f64>> {
        let found = self.find(group, name)?;
        let width = usize::try_from(found.kind).ok().filter(|width| *width > 0)?;
        let values = found.values.chunks_exact(width).take(MAX_LIST);
        values
            .map(|bytes| match *bytes {
                [byte] => Some(f64::from(byte)),
                [a, b] => Some(f64::from(self.order.u16([a, b]))),
                [a, b, c, d] => Some(shortest_decimal(self.order.f32([a, b, c, d]))),
                _ => None,
            })
            .collect()
    }

    /// Returns the first number in a parameter; `None` if there is none.
    pub(super) fn number(&self, group: &str, name: &str) -> Option<f64> {
        self.numbers(group, name)?.first().copied()
    }

    /// Returns the first number in a parameter as an unsigned 16-bit integer; `None` if there is none.
    pub(super) fn whole(&self, group: &str, name: &str) -> Option<usize> {
        Some(usize::from(self.number(group, name)? as u16))
    }

    /// Returns a whole number that is stored as one number or as the lower and upper 16 bits; `None` if there is none.
    pub(super) fn long_number(&self, group: &str, name: &str) -> Option<i64> {
        match self.numbers(group, name)?[..] {
            [low, high, ..] => Some(i64::from(low as u16) + 65536 * i64::from(high as u16)),
            [number] if number.abs() <= u32::MAX.into() => Some(number as i64),
            _ => None,
        }
    }

    /// Returns the strings in a parameter, without surrounding spaces; `None` if there is no such text parameter.
    pub(super) fn texts(&self, group: &str, name: &str) -> Option<Vec<&'f [u8]>> {
        let found = self.find(group, name).filter(|found| found.kind == -1)?;
        let texts = found.values.chunks_exact(found.width.max(1)).take(MAX_LIST);
        let texts = texts.filter_map(|text| text.split(|&byte| byte == 0).next());
        Some(texts.map(<[u8]>::trim_ascii).collect())
    }
}

/// Parses a parameter from `content`, which begins with the byte that states the parameter's type. Also returns the
/// number of bytes that its type, dimensions and values take up. Returns `None` if `content` is too short.
fn parameter<'f>(group: u8, name: &'f [u8], content: &'f [u8]) -> Option<(Parameter<'f>, usize)> {
    let [kind, dimensions] = bytes_at::<2>(content, 0)?;
    let kind = kind.cast_signed();
    let sizes = content.get(2..2 + usize::from(dimensions))?;
    let count = sizes.iter().try_fold(1_usize, |count, &size| count.checked_mul(size.into()))?;
    let length = count.checked_mul(usize::from(kind.unsigned_abs()))?;
    let values = content.get(2 + sizes.len()..)?.get(..length)?;
    let width = sizes.first().copied().map_or(1, usize::from);
    let bytes = 2 + sizes.len() + length;
    Some((Parameter { group, name, kind, width, values }, bytes))
}

/// Returns the shortest decimal number that rounds to this single-precision value: 119.88 rather than
/// 119.87999725341797.
pub(super) fn shortest_decimal(single: f32) -> f64 {
    single.to_string().parse().unwrap_or(f64::NAN)
}

/// Number format of a C3D file, named after the processor types.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ByteOrder {
    /// Little-endian, as written by all current camera systems.
    Intel,
    /// Little-endian integers and VAX floats.
    Dec,
    /// Big-endian.
    Mips,
}

impl ByteOrder {
    /// Detects the number format from the fourth byte of the parameter section; returns an unknown byte as the error.
    pub(super) fn detect(section: &[u8]) -> Result<Self, u8> {
        match section.get(3) {
            Some(84) => Ok(Self::Intel),
            Some(85) => Ok(Self::Dec),
            Some(86) => Ok(Self::Mips),
            other => Err(other.copied().unwrap_or(0)),
        }
    }

    pub(super) fn i16(self, bytes: [u8; 2]) -> i16 {
        match self {
            Self::Intel | Self::Dec => i16::from_le_bytes(bytes),
            Self::Mips => i16::from_be_bytes(bytes),
        }
    }

    pub(super) fn u16(self, bytes: [u8; 2]) -> u16 {
        self.i16(bytes).cast_unsigned()
    }

    pub(super) fn f32(self, bytes: [u8; 4]) -> f32 {
        let [a, b, c, d] = bytes;
        match self {
            Self::Intel => f32::from_le_bytes(bytes),
            // The 16-bit halves are swapped, and the exponent has a different bias.
            Self::Dec => f32::from_le_bytes([c, d, a, b]) / 4.0,
            Self::Mips => f32::from_be_bytes(bytes),
        }
    }
}

/// Returns `N` bytes starting at a position; `None` if there are fewer.
pub(super) fn bytes_at<const N: usize>(bytes: &[u8], at: usize) -> Option<[u8; N]> {
    bytes.get(at..)?.first_chunk().copied()
}
