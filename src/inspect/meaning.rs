//! Units and meanings of the columns that trilink writes, by their names.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use trilink_base::Named as _;
use trilink_robot::Quantity;

/// `meanings.toml`.
#[derive(Default, serde::Deserialize)]
struct Meanings {
    units: BTreeMap<String, String>,
    parts: BTreeMap<String, String>,
    meanings: BTreeMap<String, String>,
}

static KNOWN: LazyLock<Meanings> =
    LazyLock::new(|| toml::from_str(include_str!("meanings.toml")).unwrap_or_default());

/// A column's name without one of the `parts`, and the meaning of that part.
fn without_part(name: &str) -> Option<(&str, &'static str)> {
    let found = KNOWN.parts.iter().filter_map(|(part, what)| {
        let rest = name.strip_suffix(part.as_str()).or_else(|| name.strip_prefix(part.as_str()))?;
        Some((rest, what.as_str()))
    });
    found.min_by_key(|(rest, _)| rest.len())
}

/// A column's name without its unit, and the unit. A unit follows a word: `j_d` is a part of the objective.
fn without_unit(name: &str) -> Option<(&str, &'static str)> {
    let rest = |end: &String| name.strip_suffix(end.as_str()).filter(|rest| !rest.is_empty());
    let found = KNOWN.units.iter().filter_map(|(end, unit)| Some((rest(end)?, unit.as_str())));
    found.min_by_key(|(rest, _)| rest.len())
}

/// The unit at the end of a column's name.
pub fn unit(name: &str) -> Option<&'static str> {
    let name = without_part(name).map_or(name, |(name, _)| name);
    without_unit(name).map(|(_, unit)| unit)
}

/// What a column of that name means in trilink's tables.
pub fn meaning(name: &str) -> Option<String> {
    if let Some((name, what)) = without_part(name) {
        return meaning(name).map(|meaning| format!("{what}{meaning}"));
    }
    let (plain, number) = without_number(name);
    // Quantities of different units share a beginning: `skid0_kg_s`, `skid0_m_s`.
    let known = |name: &str| KNOWN.meanings.get(name).map(String::as_str);
    let of_robot = || {
        let meaning = Quantity::of_name(&plain)?.definition().meaning;
        (!meaning.is_empty()).then_some(meaning)
    };
    let by_stem = || known(without_unit(&plain)?.0);
    let meaning = known(&plain).or_else(of_robot).or_else(by_stem)?;
    Some(number.map_or(meaning.to_owned(), |number| format!("{meaning}, {number}")))
}

/// A name without the number of its wheel, link or joint.
fn without_number(name: &str) -> (String, Option<char>) {
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
    fn units_are_what_the_names_say() {
        for (name, expected) in [
            ("d_m", Some("m")),
            ("d_m_se", Some("m")),
            ("v_m_s", Some("m/s")),
            ("omega_rad_s", Some("rad/s")),
            ("skid0_kg_s_lo", Some("kg/s")),
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
    fn columns_mean_what_their_parts_say() {
        for (name, expected) in [
            ("d_m", "distance covered in a cycle (eq. 17)"),
            ("sigma1_se", "standard error: skid ratio of the wheel (eq. 20), 1"),
            ("skid2_kg_s", "skid resistance c^S of the wheel (eq. 15), 2"),
            ("skid2_m_s", "speed at which the wheel skids sideways, 2"),
            (
                "coulomb_viscous_joint_dry_nm",
                "of viscous resistance or damping and dry friction: torque of dry friction in the \
                 passive joint",
            ),
            (
                "began_stiffness_nm_rad",
                "where the search began: spring k_tau of the passive joint (eq. 11)",
            ),
        ] {
            assert_eq!(meaning(name).as_deref(), Some(expected), "{name}");
        }
        assert_eq!(meaning("wavelength"), None);
    }
}
