//! Tests that repeated solutions do not allocate.

use allocation_counter::measure;
use trilink_mechanics::{FIT_ACCURACY, Laws, Problem, Solver};
use trilink_robot::{Gait, Robot};

fn problems(omega_rad_s: f64) -> Vec<Problem> {
    let kinds = [
        (Robot::kinematic(), Gait::symmetric(), Laws::SKID_ROLL),
        (Robot::kinematic(), Gait::skewed(), Laws::SKID),
        (Robot::kinematic(), Gait::skewed(), Laws::NO_SKID),
        (Robot::semi_passive(), Gait::passive_symmetric(), Laws::SKID_ROLL),
        (Robot::semi_passive(), Gait::passive_symmetric(), Laws::NO_SKID_ROLL),
    ];
    at_frequency(&kinds, omega_rad_s)
}

/// Returns problems under dry friction, with both joints commanded and with one passive.
fn dry_problems(omega_rad_s: f64) -> Vec<Problem> {
    let kinds = [
        (Robot::kinematic(), Gait::symmetric(), Laws::COULOMB),
        (Robot::kinematic(), Gait::skewed(), Laws::COULOMB_VISCOUS),
        (Robot::semi_passive(), Gait::passive_symmetric(), Laws::COULOMB),
    ];
    at_frequency(&kinds, omega_rad_s)
}

fn at_frequency(kinds: &[(Robot, Gait, Laws)], omega_rad_s: f64) -> Vec<Problem> {
    let kinds = kinds.iter().cloned();
    kinds.map(|(robot, gait, laws)| Problem { robot, gait, laws, omega_rad_s }).collect()
}

#[test]
fn a_solution_after_the_first_allocates_nothing() {
    // The lowest frequency needs the most elements, so that the buffers are large enough for the others;
    // under dry friction this is not certain.
    let viscous = problems(0.5).into_iter().zip(problems(3.9));
    let dry = dry_problems(3.9).into_iter().zip(dry_problems(3.9));
    for (first, next) in viscous.chain(dry) {
        let mut solver = Solver::default();
        let mut solve = |problem: &Problem| {
            let counted = measure(|| {
                solver.forget();
                solver.solve(problem, FIT_ACCURACY).unwrap();
                solver.solve(problem, FIT_ACCURACY).unwrap();
                solver.floquet().unwrap();
                solver.work_and_loss_j().unwrap();
                solver.polish().unwrap();
                solver.derivatives().unwrap();
            });
            counted.count_total
        };
        let at_first = solve(&first);
        assert!(at_first > 0 || !first.laws.skids(), "the counter does not count");
        assert_eq!(solve(&next), 0, "{:?} {:?}", next.laws, next.gait);
    }
}
