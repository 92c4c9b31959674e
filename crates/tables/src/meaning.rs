//! Units and meanings of the columns that trilink writes, by name.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use trilink_base::Named as _;
use trilink_robot::Quantity;

/// Contents of `meanings.toml`.
#[derive(Default, serde::Deserialize)]
struct Meanings {
    units: BTreeMap<String, String>,
    parts: BTreeMap<String, String>,
    meanings: BTreeMap<String, String>,
}

static KNOWN: LazyLock<Meanings> =
    LazyLock::new(|| toml::from_str(include_str!("meanings.toml")).unwrap_or_default());

/// Splits the longest known prefix or suffix off a column's name; returns the rest of the name and the meaning of the
/// affix, or `None` if there is no known affix.
fn split_affix(name: &str) -> Option<(&str, &'static str)> {
    let splits = KNOWN.parts.iter().filter_map(|(affix, meaning)| {
        let rest =
            name.strip_suffix(affix.as_str()).or_else(|| name.strip_prefix(affix.as_str()))?;
        Some((rest, meaning.as_str()))
    });
    splits.min_by_key(|(rest, _)| rest.len())
}

/// Splits a column's name into the stem, which must not be empty, and its unit; `None` if it does not end with a known
/// unit.
fn split_unit(name: &str) -> Option<(&str, &'static str)> {
    let splits = KNOWN.units.iter().filter_map(|(suffix, unit)| {
        let stem = name.strip_suffix(suffix.as_str()).filter(|stem| !stem.is_empty())?;
        Some((stem, unit.as_str()))
    });
    splits.min_by_key(|(stem, _)| stem.len())
}

/// Suffixes of columns that contain pure numbers, whatever the unit of the quantity in the rest of the name.
const PURE_NUMBERS: [&str; 2] = ["_dof", "_coverage_factor"];

/// Returns the unit in a column's name, such as `m/s` for `v_m_s`; `None` if there is no unit.
pub fn unit(name: &str) -> Option<&'static str> {
    if PURE_NUMBERS.iter().any(|suffix| name.ends_with(suffix)) {
        return None;
    }
    let name = split_affix(name).map_or(name, |(name, _)| name);
    split_unit(name).map(|(_, unit)| unit)
}

/// Returns the meaning of a column in trilink's tables; `None` if it is unknown.
pub fn meaning(name: &str) -> Option<String> {
    if let Some((rest, prefix)) = split_affix(name) {
        return meaning(rest).map(|meaning| format!("{prefix}{meaning}"));
    }
    let (plain, number) = split_number(name);
    // The name with its unit comes first, because quantities of different units may share a stem, as `skid0_kg_s` and
    // `skid0_m_s` do.
    let meaning = known_meaning(&plain)
        .or_else(|| robot_meaning(&plain))
        .or_else(|| known_meaning(split_unit(&plain)?.0))?;
    Some(number.map_or(meaning.to_owned(), |number| format!("{meaning}, {number}")))
}

fn known_meaning(name: &str) -> Option<&'static str> {
    KNOWN.meanings.get(name).map(String::as_str)
}

/// Returns the meaning of a quantity of the robot; `None` if the name is that of no such quantity.
fn robot_meaning(name: &str) -> Option<&'static str> {
    let meaning = Quantity::of_name(name)?.definition().meaning;
    (!meaning.is_empty()).then_some(meaning)
}

/// Splits the number of a wheel, link or joint off a name: `skid0_kg_s` gives `skid_kg_s` and 0. The number is `None`
/// if the name has none.
fn split_number(name: &str) -> (String, Option<char>) {
    let mut parts: Vec<&str> = name.split('_').collect();
    for part in &mut parts {
        let stem = part.trim_end_matches(|last: char| last.is_ascii_digit());
        if part.len() == stem.len() + 1 && stem.len() > 1 {
            let number = part.chars().next_back();
            *part = stem;
            return (parts.join("_"), number);
        }
    }
    (name.to_owned(), None)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_of_meanings_is_well_formed() {
        toml::from_str::<Meanings>(include_str!("meanings.toml")).unwrap();
    }

    #[test]
    fn units_follow_from_names() {
        for (name, expected) in [
            ("d_m", Some("m")),
            ("d_m_se", Some("m")),
            ("v_m_s", Some("m/s")),
            ("skid0_m_s_se", Some("m/s")),
            ("omega_rad_s", Some("rad/s")),
            ("skid0_kg_s_lo", Some("kg/s")),
            ("skid0_kg_s_u_a", Some("kg/s")),
            ("skid0_kg_s_dof", None),
            ("skid0_kg_s_coverage_factor", None),
            ("damping_nm_s_rad", Some("N m s/rad")),
            ("inertia_kg_m2", Some("kg m^2")),
            ("decay_1_s", Some("1/s")),
            ("residual0_mm", Some("mm")),
            ("sigma0", None),
            ("trial", None),
            ("status", None),
        ] {
            assert_eq!(unit(name), expected, "{name}");
        }
    }

    #[test]
    fn meanings_are_composed_from_parts_of_names() {
        for (name, expected) in [
            ("d_m", "displacement per cycle (eq. 17)"),
            ("sigma1_se", "standard error: skid ratio of the wheel (eq. 20), 1"),
            ("skid2_kg_s", "skid resistance c^S of the wheel (eq. 15), 2"),
            ("skid2_m_s", "skid velocity of the wheel, 2"),
            ("skid2_m_s_se", "standard error: skid velocity of the wheel, 2"),
            (
                "coulomb_viscous_joint_dry_nm",
                "law with viscous resistance or damping and dry friction: torque of dry friction in \
                 the passive joint",
            ),
            (
                "began_stiffness_nm_rad",
                "start of the search: spring stiffness k_tau of the passive joint (eq. 11)",
            ),
        ] {
            assert_eq!(meaning(name).as_deref(), Some(expected), "{name}");
        }
        assert_eq!(meaning("wavelength"), None);
    }
}
