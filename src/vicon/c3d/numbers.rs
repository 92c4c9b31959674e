//! Numbers as the processors wrote them on which C3D files were made.

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
    pub fn of(section: &[u8]) -> Result<Self, u8> {
        match section.get(3) {
            Some(84) => Ok(Self::Intel),
            Some(85) => Ok(Self::Dec),
            Some(86) => Ok(Self::Mips),
            other => Err(other.copied().unwrap_or(0)),
        }
    }

    pub fn i16(self, bytes: [u8; 2]) -> i16 {
        match self {
            Self::Intel | Self::Dec => i16::from_le_bytes(bytes),
            Self::Mips => i16::from_be_bytes(bytes),
        }
    }

    pub fn u16(self, bytes: [u8; 2]) -> u16 {
        self.i16(bytes).cast_unsigned()
    }

    pub fn f32(self, bytes: [u8; 4]) -> f32 {
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
