//! Tests of statements in the paper's sections II.A to II.C and in its tables, for its robots as chains whose joints are
//! all free. The page "The scorecard" lists them.

use std::f64::consts::TAU;

use nalgebra::{DMatrix, Matrix3, SMatrix, Vector3};
use trilink_robot::{FreeJoint, Gait, Joint, Laws, Robot};

use super::{at, balance, chain};

/// Coefficients of the velocities (along and across link 0, turning rate, joint rates) at a shape of the robot.
struct Shape {
    /// Skid velocity of each wheel, by the number of its link: the matrix `W` of eq. 1 at theta = 0.
    skid: SMatrix<f64, 3, 5>,
    mass: SMatrix<f64, 5, 5>,
}

impl Shape {
    fn new(robot: &Robot, phi_rad: [f64; 2]) -> Self {
        let mut chain = chain(robot, &Gait::symmetric(), Laws::NO_SKID);
        chain.joints.fill(Joint::Free(FreeJoint::default()));
        let (system, node, posture) = at::<3, 5>(&chain, true, 0.0, [0.0; 5], &phi_rad);
        let rows = chain.numbering().into_iter().map(|link| {
            let (cluster, ..) = system.wheels[link];
            let wheel = system.wheel(&posture, &node.wheels[link], cluster);
            system.skid_row::<f64, 3, 5>(&posture, &wheel, cluster)
        });
        let rows: Vec<[f64; 5]> = rows.collect();
        let mass = balance::<3, 5>(&chain, true, 0.0, [[0.0; 5]; 2], &phi_rad).mass;
        Self {
            skid: SMatrix::from_fn(|i, j| rows[i][j]),
            mass: SMatrix::from_fn(|i, j| mass[i][j]),
        }
    }

    /// Returns the part `W_b` of `W` that belongs to the velocities of link 0.
    fn body(&self) -> Matrix3<f64> {
        self.skid.fixed_view::<3, 3>(0, 0).into()
    }

    fn det_wb(&self) -> f64 {
        self.body().determinant()
    }

    /// Returns the determinant of the matrix `A = [[M_pp, -W_p^T], [W_p, 0]]` of the constrained dynamics (eq. 10), in
    /// which the first `passive` coordinates are passive.
    fn det_a(&self, passive: usize) -> f64 {
        let mut matrix = DMatrix::zeros(passive + 3, passive + 3);
        let rows = self.skid.columns(0, passive);
        matrix
            .view_mut((0, 0), (passive, passive))
            .copy_from(&self.mass.view((0, 0), (passive, passive)));
        matrix.view_mut((0, passive), (passive, 3)).copy_from(&-rows.transpose());
        matrix.view_mut((passive, 0), (3, passive)).copy_from(&rows);
        matrix.determinant()
    }

    /// Returns the part of the wheels' skid velocities due to the joint rates that no velocity of link 0 can cancel at a
    /// singular shape, as a fraction of all skid velocities due to the joint rates. Unless it is zero, the velocities
    /// that the no-skid constraints require are unbounded at that shape.
    fn constraint_residual(&self, rates: [f64; 2]) -> f64 {
        let driven: Vector3<f64> = self.skid.column(3) * rates[0] + self.skid.column(4) * rates[1];
        let body = self.body();
        let met = body.svd(true, true).solve(&driven, 1e-9).unwrap();
        (body * met - driven).norm() / driven.norm()
    }
}

/// Returns joint angles `[phi1, phi2]` (rad) that differ.
fn shapes() -> impl Iterator<Item = [f64; 2]> {
    const SHAPES_DEG: [[f64; 2]; 6] =
        [[20.0, -35.0], [-50.0, 10.0], [61.0, 40.0], [-15.0, -70.0], [5.0, 30.0], [75.0, -44.0]];
    SHAPES_DEG.into_iter().map(|phi| phi.map(f64::to_radians))
}

/// Returns equal joint angles (rad), the paper's first type of singular shape.
fn equal_angles() -> impl Iterator<Item = [f64; 2]> {
    (-12..=12).map(|k| [f64::from(5 * k).to_radians(); 2])
}

/// Returns joint angles (rad) of the paper's second type of singular shape, at which
/// `h cos((phi2 - phi1) / 2) = -l cos((phi1 + phi2) / 2)`.
fn opposed_angles(robot: &Robot) -> impl Iterator<Item = [f64; 2]> + use<> {
    let ratio = robot.l_m[0] / robot.h_m[0];
    (-8..=8).map(move |k| {
        let middle = f64::from(10 * k).to_radians();
        let half = (-ratio * middle.cos()).acos();
        [middle - half, middle + half]
    })
}

#[test]
fn eq_1_gives_the_velocities_of_the_wheels_across_their_links() {
    let robot = Robot { h_m: [0.144, 0.12], l_m: [0.112, 0.13], ..Robot::kinematic() };
    let ([h1, h2], [l1, l2]) = (robot.h_m, robot.l_m);
    for [phi1, phi2] in shapes() {
        let printed: SMatrix<f64, 3, 5> = SMatrix::from([
            [0.0, phi1.sin(), -phi2.sin()],
            [1.0, phi1.cos(), phi2.cos()],
            [0.0, l1 + h1 * phi1.cos(), -l2 - h2 * phi2.cos()],
            [0.0, -l1, 0.0],
            [0.0, 0.0, -l2],
        ]);
        let error = (Shape::new(&robot, [phi1, phi2]).skid - printed).amax();
        assert!(error < 1e-12, "{phi1} {phi2}: {error:e}");
    }
}

/// The two inputs and the three no-skid constraints of the kinematic robot determine its motion; the semi-passive robot
/// has four unactuated coordinates, so that the constraints leave one degree of freedom to the dynamics (sections I and
/// II.C).
#[test]
fn only_the_semi_passive_robot_has_a_degree_of_freedom_left() {
    for phi in shapes() {
        let kinematic = Shape::new(&Robot::kinematic(), phi).skid.columns(0, 3).into_owned();
        let passive = Shape::new(&Robot::semi_passive(), phi).skid.columns(0, 4).into_owned();
        assert_eq!([kinematic.rank(1e-9), passive.rank(1e-9)], [3, 3], "{phi:?}");
    }
}

/// Only the zeros of det W_b matter, because they are the singular shapes; they are the same as in eq. 4.
#[test]
fn det_w_b_has_the_opposite_sign_of_eq_4() {
    let robot = Robot::kinematic();
    for [phi1, phi2] in shapes() {
        let det = Shape::new(&robot, [phi1, phi2]).det_wb();
        let eq4 = robot.h_m[0] * (phi2 - phi1).sin() + robot.l_m[0] * (phi2.sin() - phi1.sin());
        assert!((det / eq4 + 1.0).abs() < 1e-9, "{phi1} {phi2}: {det} {eq4}");
    }
}

#[test]
fn det_w_b_is_zero_on_singular_shapes_of_both_types() {
    let robot = Robot::kinematic();
    for phi in equal_angles().chain(opposed_angles(&robot)) {
        let det = Shape::new(&robot, phi).det_wb();
        assert!(det.abs() < 1e-12, "{phi:?}: {det}");
    }
}

/// At `phi1 = phi2 = 0`, all joint rates satisfy eq. 5, `phi1' sin phi2 + phi2' sin phi1 = 0`, and the velocities are
/// bounded only if eq. 6 holds: `phi1' = -phi2'`.
#[test]
fn velocities_are_bounded_where_eq_5_holds_and_on_equal_angles_where_eq_6_does() {
    let robot = Robot::kinematic();
    for phi in opposed_angles(&robot) {
        let shape = Shape::new(&robot, phi);
        let [rate1, rate2] = [phi[0].sin(), -phi[1].sin()];
        assert!(shape.constraint_residual([rate1, rate2]) < 1e-9, "{phi:?}");
        assert!(shape.constraint_residual([rate1, 2.0 * rate2]) > 1e-3, "{phi:?}");
    }
    for phi in equal_angles() {
        let shape = Shape::new(&robot, phi);
        assert!(shape.constraint_residual([1.0, -1.0]) < 1e-9, "{phi:?}");
        assert!(shape.constraint_residual([1.0, 1.0]) > 1e-3, "{phi:?}");
    }
}

/// The paper states `det A = -det(W_b)^2` below eq. 10, with the opposite sign; only the zeros of det A matter, and they
/// are the same.
#[test]
fn det_a_of_the_kinematic_robot_is_plus_the_square_of_det_w_b() {
    for phi in shapes() {
        let shape = Shape::new(&Robot::kinematic(), phi);
        assert!((shape.det_a(3) / shape.det_wb().powi(2) - 1.0).abs() < 1e-9, "{phi:?}");
    }
}

#[test]
fn det_a_of_the_semi_passive_robot_is_far_from_zero_up_to_90_degrees() {
    let robot = Robot::semi_passive();
    let grid = || (-9..=9).map(|k| f64::from(10 * k).to_radians());
    let all = grid().flat_map(|phi1| grid().map(move |phi2| [phi1, phi2]));
    let found: Vec<f64> = all.map(|phi| Shape::new(&robot, phi).det_a(4)).collect();
    let low = found.iter().copied().fold(f64::INFINITY, f64::min);
    let high = found.iter().copied().fold(0.0, f64::max);
    assert!(low > 0.01 * high, "{low} {high}");
}

#[test]
fn the_symmetric_gait_crosses_equal_angles_and_the_skewed_one_does_not() {
    let crossings = |gait: Gait| {
        let apart = |i: i32| {
            let phase_rad = TAU * (f64::from(i) + 0.5) / 360.0;
            let [phi1, phi2] = gait.joints.map(|joint| joint.unwrap().derivative(0, phase_rad));
            phi1 - phi2
        };
        (0..360).filter(|i| apart(*i) * apart(i + 1) < 0.0).count()
    };
    assert_eq!([crossings(Gait::symmetric()), crossings(Gait::skewed())], [2, 0]);
}

#[test]
fn table_2_has_heavier_identical_side_links() {
    let kinematic = Robot::kinematic();
    let passive = Robot::semi_passive();
    assert!(passive.mass_kg[1] > kinematic.mass_kg[1]);
    assert_eq!(passive.mass_kg[1], passive.mass_kg[2]);
    assert_eq!(passive.inertia_kg_m2[1], passive.inertia_kg_m2[2]);
}

#[test]
fn inertias_of_table_1_are_not_those_of_uniform_bars_between_the_joints() {
    let robot = Robot::kinematic();
    let bar = |mass_kg: f64, length_m: f64| mass_kg * length_m * length_m / 12.0;
    let bars = [(0, 2.0 * robot.h_m[0], 0.315), (1, 2.0 * robot.b_m[0], 0.173)];
    for (link, length_m, right_m) in bars {
        let printed = robot.inertia_kg_m2[link];
        // Tolerance: half of the last printed digit.
        assert!((bar(robot.mass_kg[link], length_m) - printed).abs() > 0.5e-4, "link {link}");
        assert!((bar(robot.mass_kg[link], right_m) - printed).abs() < 0.5e-4, "link {link}");
    }
}
