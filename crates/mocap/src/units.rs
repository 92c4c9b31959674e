//! Names of length units in marker files.

use trilink_base::LengthUnit;

/// Parses the name of a unit, ignoring case; `None` if it is unknown.
pub(super) fn parse(text: &[u8]) -> Option<LengthUnit> {
    Some(match text.to_ascii_lowercase().as_slice() {
        b"mm" | b"millimeter" | b"millimeters" | b"millimetre" | b"millimetres" => LengthUnit::Mm,
        b"cm" | b"centimeter" | b"centimeters" | b"centimetre" | b"centimetres" => LengthUnit::Cm,
        b"m" | b"meter" | b"meters" | b"metre" | b"metres" => LengthUnit::M,
        b"in" | b"inch" | b"inches" => LengthUnit::In,
        _ => return None,
    })
}

/// Returns a list of the known units for a message.
pub(super) fn needed() -> String {
    format!("a unit of length: `{}`", LengthUnit::ALL.map(LengthUnit::name).join("`, `"))
}
