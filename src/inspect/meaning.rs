//! Units and meanings of the columns that trilink writes, by their names.

/// Ends of names and the units that they say; longer ends first.
const UNITS: [(&str, &str); 16] = [
    ("_nm_s_rad", "N m s/rad"),
    ("_nm_rad", "N m/rad"),
    ("_rad_s", "rad/s"),
    ("_kg_m2", "kg m^2"),
    ("_kg_s", "kg/s"),
    ("_1_s", "1/s"),
    ("_m_s", "m/s"),
    ("_rad", "rad"),
    ("_deg", "deg"),
    ("_mm", "mm"),
    ("_kg", "kg"),
    ("_nm", "N m"),
    ("_m", "m"),
    ("_s", "s"),
    ("_n", "N"),
    ("_w", "W"),
];

/// Beginnings of names, without a wheel's, link's or joint's number at the end.
const MEANINGS: [(&str, &str); 62] = [
    ("trial", "name of the trial"),
    ("campaign", "campaign that it belongs to; empty where there is none"),
    ("model", "which forces resist the wheels"),
    ("robot", "robot of the configuration"),
    ("kind", "gait, joint-release or coast-down"),
    ("frame", "number of the frame"),
    ("time", "time after the first frame or phase 0"),
    ("cycle", "number of the cycle"),
    ("cycles", "cycles that the means are taken over"),
    ("start_s", "when the cycle starts, after the first frame"),
    ("used", "whether the cycle counts towards the trial's means"),
    ("x", "place of the middle link's wheel axle"),
    ("y", "place of the middle link's wheel axle"),
    ("theta", "heading of the middle link, unwrapped"),
    ("phi", "joint angle"),
    ("roll_m_s", "speed at which the wheel rolls"),
    ("skid_m_s", "speed at which the wheel skids sideways"),
    ("fill", "where the link's pose comes from: measured, rigid, interpolated or missing"),
    ("outlier", "what was wrong with the link's markers and what was done about it"),
    ("omega", "frequency of the gait, as measured where it is a trial's"),
    ("omega_commanded", "frequency that was commanded"),
    ("d", "distance covered in a cycle (eq. 17)"),
    ("v", "mean speed over a cycle"),
    ("sigma", "skid ratio of the wheel (eq. 20)"),
    ("sigma_debiased", "skid ratio of the wheel without the markers' noise"),
    ("alpha", "amplitude of the passive joint: half of peak to peak"),
    ("dtheta", "rotation in a cycle"),
    ("phi_offset", "mean of the measured joint angle"),
    ("phi_amplitude", "first harmonic of the measured joint angle"),
    ("phi_phase", "phase of that harmonic"),
    ("phi_harmonics", "RMS of the joint's higher harmonics"),
    ("coverage", "part of all markers' frames that the cameras saw"),
    ("residual", "residual of the rigid fit"),
    ("smoothing_window", "width of the moving average, samples"),
    ("smoothing_left", "part of a gait's harmonic that the moving average leaves"),
    ("status", "how it ended"),
    ("message", "in words"),
    ("check", "code and name of the check"),
    ("severity", "ok, info, warning or error"),
    ("value", "what was found or held"),
    ("limit", "what it is compared with"),
    ("skid_kg_s", "skid resistance c^S of the wheel (eq. 15)"),
    ("roll_kg_s", "roll resistance c^R of the wheel (eq. 14)"),
    ("roll_sum", "sum of the roll resistances"),
    ("stiffness", "spring k_tau of the passive joint (eq. 11)"),
    ("damping", "damper c_tau of the passive joint (eq. 11)"),
    ("free", "parameters that were fitted"),
    ("measured", "parameters that joint-releases and coast-downs gave"),
    ("identifiable", "fitted parameters that the data determine"),
    ("practically_not", "fitted parameters of which the data give no interval"),
    ("structurally_not", "fitted parameters that change nothing"),
    ("at_bound", "fitted parameters that ended at a bound"),
    ("j", "objective (eq. 22)"),
    ("limit_j", "objective above which a value is outside of the interval"),
    ("starts", "searches that were started"),
    ("solves", "steady motions that were solved for"),
    ("stopped", "why the search stopped"),
    ("replicate", "number of the resample"),
    ("parameter", "the parameter that is held"),
    ("source", "at the trials' frequencies (trial) or on a fine grid (curve)"),
    ("from_rest", "where the robot goes from rest: reached, another or unsettled"),
    ("natural", "natural frequency"),
];

/// Ends and beginnings of names that say what of a quantity it is.
const PARTS: [(&str, &str); 5] = [
    ("_se", "standard error: "),
    ("_lo", "lower 95 % confidence limit: "),
    ("_hi", "upper 95 % confidence limit: "),
    ("began_", "where the search began: "),
    ("ended_", "where the search ended: "),
];

/// A name without one of [`PARTS`], and what that says.
fn without_part(name: &str) -> Option<(&str, &'static str)> {
    PARTS.iter().find_map(|(part, what)| {
        let rest = name.strip_suffix(part).or_else(|| name.strip_prefix(part))?;
        Some((rest, *what))
    })
}

/// The unit that a column's name says.
pub fn unit(name: &str) -> Option<&'static str> {
    let name = without_part(name).map_or(name, |(name, _)| name);
    // `j_d` is a part of the objective: a unit follows a word.
    UNITS
        .iter()
        .find(|(end, _)| name.len() > end.len() && name.ends_with(end))
        .map(|(_, unit)| *unit)
}

/// What a column of that name means in trilink's tables.
pub fn meaning(name: &str) -> Option<String> {
    if let Some((name, what)) = without_part(name) {
        return meaning(name).map(|meaning| format!("{what}{meaning}"));
    }
    let (plain, number) = without_number(name);
    let known = |name: &str| MEANINGS.iter().find(|(known, _)| *known == name);
    // Quantities of different units share a beginning: `skid0_kg_s`, `skid0_m_s`.
    let without_unit = || UNITS.iter().find_map(|(end, _)| plain.strip_suffix(end));
    let (_, meaning) = known(&plain).or_else(|| known(without_unit()?))?;
    Some(number.map_or(meaning.to_string(), |number| format!("{meaning}, {number}")))
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
                "began_stiffness_nm_rad",
                "where the search began: spring k_tau of the passive joint (eq. 11)",
            ),
        ] {
            assert_eq!(meaning(name).as_deref(), Some(expected), "{name}");
        }
        assert_eq!(meaning("wavelength"), None);
    }
}
