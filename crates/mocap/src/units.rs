//! Units of length as marker files write them.

use trilink_base::LengthUnit;

/// The unit that a text names; capitals do not matter.
pub(super) fn of_text(text: &[u8]) -> Option<LengthUnit> {
    Some(match text.to_ascii_lowercase().as_slice() {
        b"mm" | b"millimeter" | b"millimeters" | b"millimetre" | b"millimetres" => LengthUnit::Mm,
        b"cm" | b"centimeter" | b"centimeters" | b"centimetre" | b"centimetres" => LengthUnit::Cm,
        b"m" | b"meter" | b"meters" | b"metre" | b"metres" => LengthUnit::M,
        b"in" | b"inch" | b"inches" => LengthUnit::In,
        _ => return None,
    })
}

/// The units, for a message.
pub(super) fn needed() -> String {
    format!("a unit of length: `{}`", LengthUnit::ALL.map(LengthUnit::name).join("`, `"))
}
