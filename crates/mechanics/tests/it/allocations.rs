//! Tests that what repeated solutions allocate does not depend on the numbers of elements and of Newton steps.

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
    kinds.map(|(robot, gait, laws)| Problem::new(robot, gait, laws, omega_rad_s)).collect()
}

/// Largest number of memory blocks, and of bytes, in [`allocated`]: descriptions of the robot, most of them for the initial
/// guess of a passive joint and for the constraints of wheels that cannot skid.
const MAX_BLOCKS: u64 = 180;
const MAX_BYTES: u64 = 40_000;
/// Blocks by which a problem can exceed another because the search for the speed of the initial guess takes longer.
const FURTHER_BLOCKS: u64 = 20;

/// Returns the number of memory blocks and of bytes that solutions of the problem allocate.
fn allocated(solver: &mut Solver, problem: &Problem) -> [u64; 2] {
    let counted = measure(|| {
        solver.forget();
        solver.solve(problem, FIT_ACCURACY).unwrap();
        solver.solve(problem, FIT_ACCURACY).unwrap();
        solver.floquet().unwrap();
        solver.work_and_loss_j().unwrap();
        solver.polish().unwrap();
    });
    [counted.count_total, counted.bytes_total]
}

#[test]
fn repeated_solutions_allocate_few_blocks_for_the_description_of_the_robot() {
    // The lowest frequency needs the most elements, so that the buffers are large enough for the others;
    // under dry friction this is not certain.
    let viscous = problems(0.5).into_iter().zip(problems(3.9));
    let dry = dry_problems(3.9).into_iter().zip(dry_problems(3.9));
    for (first, next) in viscous.chain(dry) {
        let mut solver = Solver::default();
        let [at_first, _] = allocated(&mut solver, &first);
        let of_next @ [blocks, bytes] = allocated(&mut solver, &next);
        assert!(at_first > blocks, "the buffers are not counted");
        assert!(blocks <= MAX_BLOCKS && bytes <= MAX_BYTES, "{blocks} {bytes} {next:?}");
        assert_eq!(allocated(&mut solver, &next), of_next, "{next:?}");
        let of_first = allocated(&mut solver, &first);
        assert!(of_first[0] <= blocks + FURTHER_BLOCKS, "{of_first:?} {of_next:?} {first:?}");
    }
}
