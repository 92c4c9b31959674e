//! The parameter section: named groups of named values.
//!
//! A group is `length, -id, name, next`, a parameter `length, id, name, next, type, dimensions,
//! values`; `next` leads from its own place to the following record and is 0 in the last one.

/// Longest list of values that a dimension can have.
const LONGEST_LIST: usize = 255;

/// Groups and parameters, still as they are in the file.
pub(super) struct Parameters<'f> {
    pub order: ByteOrder,
    groups: Vec<(u8, &'f [u8])>,
    parameters: Vec<Parameter<'f>>,
}

struct Parameter<'f> {
    group: u8,
    name: &'f [u8],
    /// Bytes a value; text has -1.
    kind: i8,
    /// First dimension; 1 for a single value.
    width: usize,
    values: &'f [u8],
}

impl<'f> Parameters<'f> {
    /// Reads a section of so many bytes up to its last record, after which zeros stand or the
    /// section's end. `None` if it leads out of the bytes that are there.
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
                // Some programs leave anything in the last one. Behind a record is its description.
                at = end + 1 + section.get(end).map_or(0, |&bytes| usize::from(bytes));
            }
        }
        Some(read)
    }

    fn find(&self, group: &str, name: &str) -> Option<&Parameter<'f>> {
        let is = |found: &[u8], name: &str| found.eq_ignore_ascii_case(name.as_bytes());
        let (id, _) = self.groups.iter().find(|(_, found)| is(found, group))?;
        self.parameters.iter().find(|found| found.group == *id && is(found.name, name))
    }

    /// The numbers of a parameter; bytes and integers count without sign, as they do in every
    /// place where they are large.
    pub(super) fn numbers(&self, group: &str, name: &str) -> Option<Vec<f64>> {
        let found = self.find(group, name)?;
        let number = |bytes: &[u8]| match *bytes {
            [byte] => Some(f64::from(byte)),
            [a, b] => Some(f64::from(self.order.u16([a, b]))),
            [a, b, c, d] => Some(decimal(self.order.f32([a, b, c, d]))),
            _ => None,
        };
        let width = usize::try_from(found.kind).ok().filter(|width| *width > 0)?;
        found.values.chunks_exact(width).take(LONGEST_LIST).map(number).collect()
    }

    /// The first number of a parameter.
    pub(super) fn number(&self, group: &str, name: &str) -> Option<f64> {
        self.numbers(group, name)?.first().copied()
    }

    /// The texts of a parameter without trailing spaces.
    pub(super) fn texts(&self, group: &str, name: &str) -> Option<Vec<&'f [u8]>> {
        let found = self.find(group, name).filter(|found| found.kind == -1)?;
        let texts = found.values.chunks_exact(found.width.max(1)).take(LONGEST_LIST);
        let text = |text: &'f [u8]| text.split(|&byte| byte == 0).next();
        Some(texts.filter_map(text).map(<[u8]>::trim_ascii).collect())
    }
}

/// A parameter, and how many bytes type, dimensions and values have.
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

/// The number that was meant: 119.88 and not 119.87999725341797.
pub(super) fn decimal(single: f32) -> f64 {
    single.to_string().parse().unwrap_or(f64::NAN)
}

/// How a file writes its numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ByteOrder {
    /// Little-endian; what every camera system writes today.
    Intel,
    /// Little-endian integers, VAX floats.
    Dec,
    /// Big-endian.
    Mips,
}

impl ByteOrder {
    /// From the fourth byte of the parameter section; the byte if it is none that is known.
    pub(super) fn of(section: &[u8]) -> Result<Self, u8> {
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
            // The halves are swapped, and the exponent counts from another zero.
            Self::Dec => f32::from_le_bytes([c, d, a, b]) / 4.0,
            Self::Mips => f32::from_be_bytes(bytes),
        }
    }
}

/// `N` bytes from a position on, if they are there.
pub(super) fn bytes_at<const N: usize>(bytes: &[u8], at: usize) -> Option<[u8; N]> {
    bytes.get(at..)?.first_chunk().copied()
}
