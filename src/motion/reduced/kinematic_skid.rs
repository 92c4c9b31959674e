//! Both joints commanded, wheels that skid.

use super::{
    ByParameters, CommandNode, Driven, Moment, Reduced, Residual, Variable, by_coefficients,
};
use crate::robot::{Balance, Parameter, force_balance, mass_matrix, roll_rows, skid_rows};

/// Both joints commanded, wheels that skid. States `u, v, theta'`.
#[derive(Debug, Clone)]
pub struct KinematicSkid(pub Driven);

impl KinematicSkid {
    #[inline(always)]
    fn equations(
        &self,
        node: &CommandNode,
        y: &[f64; 3],
        dy: &[f64; 3],
    ) -> (Residual<3>, Balance, [[f64; 5]; 5]) {
        let velocity = self.moment(node, y).velocity;
        let acceleration = self.acceleration(node, y, dy);
        let (robot, trig) = (&self.0.robot, &node.trig);
        let balance =
            force_balance(robot, None, node.shape.phi_rad, trig, &velocity, &acceleration);
        let mass = mass_matrix(robot, trig);
        let body = |full: &[[f64; 5]; 5]| -> [[f64; 3]; 3] {
            std::array::from_fn(|i| std::array::from_fn(|j| full[i][j]))
        };
        let residual = Residual {
            value: std::array::from_fn(|i| balance.force[i]),
            by_state: body(&balance.dforce_dvelocity),
            by_rate: body(&mass),
        };
        (residual, balance, mass)
    }
}

impl Reduced<3> for KinematicSkid {
    const PARAMETERS: usize = 8;
    const SKIDS: bool = true;
    const INTEGRATED: bool = false;
    const HAS_ANGLE: bool = false;

    type Node = CommandNode;

    fn node(&self, phase_rad: f64) -> CommandNode {
        CommandNode::new(&self.0, phase_rad)
    }

    #[inline(always)]
    fn residual(&self, node: &CommandNode, y: &[f64; 3], dy: &[f64; 3]) -> Residual<3> {
        self.equations(node, y, dy).0
    }

    fn variable(&self, column: usize) -> Variable {
        match column {
            0..3 => Variable::Parameter(Parameter::SKID[column]),
            3..6 => Variable::Parameter(Parameter::ROLL[column - 3]),
            _ => Variable::Amplitude(column - 6),
        }
    }

    #[inline(always)]
    fn sensitivity(
        &self,
        node: &CommandNode,
        y: &[f64; 3],
        dy: &[f64; 3],
        by: &mut ByParameters<3>,
    ) -> Residual<3> {
        let (residual, balance, mass) = self.equations(node, y, dy);
        let velocity = self.moment(node, y).velocity;
        let by_skid = by_coefficients(&skid_rows(&self.0.robot, &node.trig), &velocity);
        let by_roll = by_coefficients(&roll_rows(&self.0.robot, &node.trig), &velocity);
        for (i, by) in by.iter_mut().enumerate() {
            for wheel in 0..3 {
                by[wheel] = by_skid[wheel][i];
                by[3 + wheel] = by_roll[wheel][i];
            }
            for (a, [phi, rate, acceleration]) in node.waves.into_iter().enumerate() {
                by[6 + a] = balance.dforce_dphi[a][i] * phi
                    + balance.dforce_dvelocity[i][3 + a] * rate
                    + mass[i][3 + a] * acceleration;
            }
        }
        residual
    }

    #[inline(always)]
    fn moment(&self, node: &CommandNode, y: &[f64; 3]) -> Moment {
        let [w1, w2] = node.shape.rate_rad_s;
        Moment { phi_rad: node.shape.phi_rad, velocity: [y[0], y[1], y[2], w1, w2] }
    }

    #[inline(always)]
    fn acceleration(&self, node: &CommandNode, _y: &[f64; 3], dy: &[f64; 3]) -> [f64; 5] {
        let [a1, a2] = node.shape.acceleration_rad_s2;
        [dy[0], dy[1], dy[2], a1, a2]
    }

    #[inline(always)]
    fn by_state(&self, _node: &CommandNode, _y: &[f64; 3], by_moment: &Moment) -> [f64; 3] {
        let [u, v, r, ..] = by_moment.velocity;
        [u, v, r]
    }

    #[inline(always)]
    fn by_amplitude(&self, node: &CommandNode, _y: &[f64; 3], by_moment: &Moment) -> [f64; 2] {
        node.by_amplitude(by_moment)
    }

    fn half_period_signs(&self) -> Option<[f64; 3]> {
        self.0.is_mirrored().then_some([1.0, -1.0, -1.0])
    }

    fn at_rest(&self) -> [f64; 3] {
        [0.0; 3]
    }
}
