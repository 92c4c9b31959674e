//! One joint on its spring, wheels that skid.

use super::{
    ByParameters, CommandNode, Driven, Moment, Reduced, Residual, Variable, by_coefficients,
};
use crate::robot::{Balance, Parameter, Trig, force_balance, mass_matrix, roll_rows, skid_rows};

/// Joint `passive` (0 or 1) on its spring, wheels that skid. States
/// `u, v, theta', phi_p', phi_p`.
#[derive(Debug, Clone)]
pub struct PassiveSkid {
    pub driven: Driven,
    pub passive: usize,
}

impl PassiveSkid {
    /// Equations 0, 1, 2 and that of the passive joint.
    fn rows(&self) -> [usize; 4] {
        [0, 1, 2, 3 + self.passive]
    }

    fn trig(&self, node: &CommandNode, phi_rad: f64) -> Trig {
        let mut trig = node.trig;
        (trig.s[self.passive], trig.c[self.passive]) = phi_rad.sin_cos();
        trig
    }

    #[inline(always)]
    fn equations(
        &self,
        node: &CommandNode,
        trig: &Trig,
        y: &[f64; 5],
        dy: &[f64; 5],
    ) -> (Residual<5>, Balance, [[f64; 5]; 5]) {
        let (p, robot) = (self.passive, &self.driven.robot);
        let Moment { phi_rad, velocity } = self.moment(node, y);
        let acceleration = self.acceleration(node, y, dy);
        let balance = force_balance(robot, Some(p), phi_rad, trig, &velocity, &acceleration);
        let mass = mass_matrix(robot, trig);
        let rows = self.rows();
        let mut residual =
            Residual { value: [0.0; 5], by_state: [[0.0; 5]; 5], by_rate: [[0.0; 5]; 5] };
        for (i, &row) in rows.iter().enumerate() {
            residual.value[i] = balance.force[row];
            for (j, &column) in rows.iter().enumerate() {
                residual.by_state[i][j] = balance.dforce_dvelocity[row][column];
                residual.by_rate[i][j] = mass[row][column];
            }
            residual.by_state[i][4] = balance.dforce_dphi[p][row];
        }
        (residual, balance, mass)
    }
}

impl Reduced<5> for PassiveSkid {
    const PARAMETERS: usize = 9;
    const SKIDS: bool = true;
    const INTEGRATED: bool = true;
    const HAS_ANGLE: bool = true;

    type Node = CommandNode;

    fn node(&self, phase_rad: f64) -> CommandNode {
        CommandNode::new(&self.driven, phase_rad)
    }

    #[inline(always)]
    fn residual(&self, node: &CommandNode, y: &[f64; 5], dy: &[f64; 5]) -> Residual<5> {
        self.equations(node, &self.trig(node, y[4]), y, dy).0
    }

    fn variable(&self, column: usize) -> Variable {
        match column {
            0..3 => Variable::Parameter(Parameter::SKID[column]),
            3..6 => Variable::Parameter(Parameter::ROLL[column - 3]),
            6 => Variable::Parameter(Parameter::Stiffness),
            7 => Variable::Parameter(Parameter::Damping),
            _ => Variable::Amplitude(1 - self.passive),
        }
    }

    #[inline(always)]
    fn sensitivity(
        &self,
        node: &CommandNode,
        y: &[f64; 5],
        dy: &[f64; 5],
        by: &mut ByParameters<5>,
    ) -> Residual<5> {
        let (a, robot) = (1 - self.passive, &self.driven.robot);
        let trig = self.trig(node, y[4]);
        let (residual, balance, mass) = self.equations(node, &trig, y, dy);
        let velocity = self.moment(node, y).velocity;
        let by_skid = by_coefficients(&skid_rows(robot, &trig), &velocity);
        let by_roll = by_coefficients(&roll_rows(robot, &trig), &velocity);
        let [phi, rate, acceleration] = node.waves[a];
        for (by, row) in by.iter_mut().zip(self.rows()) {
            for wheel in 0..3 {
                by[wheel] = by_skid[wheel][row];
                by[3 + wheel] = by_roll[wheel][row];
            }
            (by[6], by[7]) = (0.0, 0.0);
            by[8] = balance.dforce_dphi[a][row] * phi
                + balance.dforce_dvelocity[row][3 + a] * rate
                + mass[row][3 + a] * acceleration;
        }
        (by[3][6], by[3][7]) = (y[4] - robot.rest_angle_rad, y[3]);
        residual
    }

    #[inline(always)]
    fn moment(&self, node: &CommandNode, y: &[f64; 5]) -> Moment {
        let p = self.passive;
        let mut phi_rad = node.shape.phi_rad;
        phi_rad[p] = y[4];
        let mut velocity = [y[0], y[1], y[2], 0.0, 0.0];
        velocity[3 + p] = y[3];
        velocity[4 - p] = node.shape.rate_rad_s[1 - p];
        Moment { phi_rad, velocity }
    }

    #[inline(always)]
    fn acceleration(&self, node: &CommandNode, _y: &[f64; 5], dy: &[f64; 5]) -> [f64; 5] {
        let mut acceleration = [dy[0], dy[1], dy[2], 0.0, 0.0];
        acceleration[3 + self.passive] = dy[3];
        acceleration[4 - self.passive] = node.shape.acceleration_rad_s2[1 - self.passive];
        acceleration
    }

    #[inline(always)]
    fn by_state(&self, _node: &CommandNode, _y: &[f64; 5], by_moment: &Moment) -> [f64; 5] {
        let [u, v, r, ..] = by_moment.velocity;
        [u, v, r, by_moment.velocity[3 + self.passive], by_moment.phi_rad[self.passive]]
    }

    #[inline(always)]
    fn by_amplitude(&self, node: &CommandNode, _y: &[f64; 5], by_moment: &Moment) -> [f64; 2] {
        node.by_amplitude(by_moment)
    }

    fn half_period_signs(&self) -> Option<[f64; 5]> {
        self.driven.is_mirrored().then_some([1.0, -1.0, -1.0, -1.0, -1.0])
    }

    fn at_rest(&self) -> [f64; 5] {
        [0.0, 0.0, 0.0, 0.0, self.driven.robot.rest_angle_rad]
    }
}
