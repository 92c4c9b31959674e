//! Chains with skidding wheels: equations of motion in minimal states.

use trilink_robot::{MAX_LINKS, Number, Pose};

use super::balance::{Node, Posture, System};
use super::cluster::Clusters;
use super::forces::ChainSample;
use super::{ChainProblem, OfChain};
use crate::reduced::{MAX_TRACKED, Reduced, Residual};

/// Equations of motion with skidding wheels. The states are the velocities along and across the reference link and its
/// turning rate, then the rates and then the angles of the free joints, in the order of the clusters: `N` = 2 `C` + 1
/// states for `C` clusters and `D` = `C` + 2 equations of motion.
#[derive(Debug, Clone)]
pub(super) struct Skid<const N: usize, const C: usize, const D: usize, const W: usize> {
    problem: ChainProblem,
    system: System<C, W>,
}

impl<const N: usize, const C: usize, const D: usize, const W: usize> Skid<N, C, D, W> {
    pub(super) fn new(problem: ChainProblem) -> Self {
        const { assert!(N == 2 * C + 1 && D == C + 2) };
        let clusters = Clusters::new(problem.chain.clone(), problem.omega_rad_s, W == 0);
        Self { problem, system: System::new(clusters) }
    }

    #[inline(always)]
    fn angles<T: Number>(y: &[T; N]) -> [T; C] {
        std::array::from_fn(|c| if c == 0 { T::splat(0.0) } else { y[D + c - 1] })
    }
}

impl<const N: usize, const C: usize, const D: usize, const W: usize> OfChain<N, C>
    for Skid<N, C, D, W>
{
    fn problem(&self) -> &ChainProblem {
        &self.problem
    }

    fn clusters(&self) -> &Clusters {
        &self.system.clusters
    }

    fn accelerations(
        &self,
        _: &Self::Node<f64>,
        _: &[f64; N],
        dy: &[f64; N],
    ) -> ([f64; 3], [f64; C]) {
        let joints = std::array::from_fn(|c| if c == 0 { 0.0 } else { dy[2 + c] });
        ([dy[0], dy[1], dy[2]], joints)
    }
}

impl<const N: usize, const C: usize, const D: usize, const W: usize> Reduced<N>
    for Skid<N, C, D, W>
{
    const ANGLES: usize = C - 1;
    const INTEGRATED: bool = true;
    const SKIDS: bool = true;
    const IS_LINEAR: bool = W == 0;
    const TRACKED: usize = N;

    type Node<T: Number> = Node<T, C, W>;
    super::of_chain!();

    fn with_transition_scaled(&self, factor: f64) -> Option<Self> {
        (W > 0).then(|| Self::new(self.problem.with_transition_scaled(factor)))
    }

    fn with_friction_scaled(&self, factor: f64) -> Self {
        Self::new(self.problem.with_friction_scaled(factor))
    }

    #[inline(always)]
    fn node<T: Number>(&self, phase_rad: T) -> Node<T, C, W> {
        self.system.node(phase_rad)
    }

    #[inline(always)]
    fn residual<T: Number>(&self, node: &Node<T, C, W>, y: &[T; N], dy: &[T; N]) -> Residual<N, T> {
        let zero = T::splat(0.0);
        let state = self.kinematics(node, y);
        let acceleration: [T; D] = std::array::from_fn(|i| dy[i]);
        let balance = self.system.balance(node, &state, &acceleration);
        let mut residual = Residual {
            value: [zero; N],
            state_jacobian: [[zero; N]; N],
            rate_jacobian: [[zero; N]; N],
        };
        residual.value[..D].copy_from_slice(&balance.force);
        for i in 0..D {
            residual.state_jacobian[i][..D].copy_from_slice(&balance.dforce_dvelocity[i]);
            residual.rate_jacobian[i][..D].copy_from_slice(&balance.mass[i]);
            for c in 1..C {
                residual.state_jacobian[i][D + c - 1] = balance.dforce_dphi[c][i];
            }
        }
        residual
    }

    #[inline(always)]
    fn kinematics<T: Number>(&self, node: &Node<T, C, W>, y: &[T; N]) -> Posture<T, C> {
        let rates = std::array::from_fn(|c| if c == 0 { T::splat(0.0) } else { y[2 + c] });
        self.system.posture(&node.clusters, [y[0], y[1], y[2]], Self::angles(y), rates)
    }

    fn half_period_signs(&self) -> Option<[f64; N]> {
        let signs = std::array::from_fn(|i| if i == 0 { 1.0 } else { -1.0 });
        self.problem.chain.is_mirrored().then_some(signs)
    }

    fn at_rest(&self) -> [f64; N] {
        let angles = self.rest_angles();
        std::array::from_fn(|i| if i < D { 0.0 } else { angles[i - D] })
    }
}
