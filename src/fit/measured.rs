//! The robots' own parameters as joint-release and coast-down trials measured them.

use crate::metrics::Estimate;
use crate::robot::{Parameter, Robot};
use crate::store::RobotParameterRow;

/// Gives a robot the means over its trials, where there are any, of stiffness and damping of the
/// passive joint and of the sum of the roll resistances (the proportions stay as configured);
/// says which these are.
pub(super) fn with_measured(
    robot: &mut Robot,
    name: &str,
    rows: &[RobotParameterRow],
) -> Vec<Parameter> {
    type Of = fn(&RobotParameterRow) -> Estimate;
    const MEASURED: [(Parameter, Of); 3] = [
        (Parameter::Stiffness, |row| row.stiffness_nm_rad),
        (Parameter::Damping, |row| row.damping_nm_s_rad),
        (Parameter::RollSum, |row| row.roll_sum_kg_s),
    ];
    let mut measured = Vec::new();
    for (parameter, of) in MEASURED {
        let of_robot = rows.iter().filter(|row| row.robot == name);
        let mut values: Vec<f64> = of_robot
            .map(|row| of(row).value)
            .filter(|value| *value > 0.0 && value.is_finite())
            .collect();
        if values.is_empty() {
            continue;
        }
        // The sum does not depend on the order of the trials.
        values.sort_by(f64::total_cmp);
        parameter.set(robot, values.iter().sum::<f64>() / values.len() as f64);
        measured.push(parameter);
    }
    measured
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::Columns as _;

    #[test]
    fn what_the_trials_do_not_tell_stays_as_configured() {
        let row = |robot: &str| RobotParameterRow {
            robot: robot.to_owned(),
            ..RobotParameterRow::blank()
        };
        let found = |value: f64| Estimate { value, ..Estimate::MISSING };
        let rows = [
            RobotParameterRow { roll_sum_kg_s: found(0.9), ..row("ours") },
            RobotParameterRow { roll_sum_kg_s: found(1.5), ..row("ours") },
            RobotParameterRow { stiffness_nm_rad: found(9.0), ..row("another") },
            RobotParameterRow { damping_nm_s_rad: found(0.01), ..row("ours") },
        ];
        let configured = Robot::semi_passive();
        let mut robot = configured.clone();
        let measured = with_measured(&mut robot, "ours", &rows);
        assert_eq!(measured, [Parameter::Damping, Parameter::RollSum]);
        assert_eq!(robot.stiffness_nm_rad, configured.stiffness_nm_rad);
        assert_eq!(robot.damping_nm_s_rad, 0.01);
        for (found, expected) in robot.roll_kg_s.iter().zip([0.6, 0.3, 0.3]) {
            assert!((found - expected).abs() < 1e-12);
        }
    }
}
