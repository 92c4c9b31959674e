//! `[gait.NAME]`: commands of a robot's joints and rotors.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use trilink_robot::{Gait, JointCommand, MAX_JOINTS, SecondHarmonic, TorqueCommand};

/// Gait in the configuration: commands of joints by their numbers from front to rear, and of rotors by the names of their
/// links. In the short form of three links, a joint without a command is passive; in a chain, the kind of the joint
/// determines whether it needs one.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct GaitConfig {
    pub joint1: Option<CommandConfig>,
    pub joint2: Option<CommandConfig>,
    pub joint3: Option<CommandConfig>,
    pub joint4: Option<CommandConfig>,
    pub joint5: Option<CommandConfig>,
    pub joint6: Option<CommandConfig>,
    pub joint7: Option<CommandConfig>,
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub rotor: BTreeMap<String, CommandConfig>,
}

/// Command of a joint or rotor: the angle `offset + amplitude cos(omega t + phase) + amplitude2 cos(2 omega t + phase2)`,
/// or the torque `mean + torque cos(omega t + phase)`.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct CommandConfig {
    pub offset_deg: Option<f64>,
    pub amplitude_deg: Option<f64>,
    pub phase_deg: Option<f64>,
    /// Amplitude of the second harmonic, degrees; `None` if the command has no second harmonic.
    pub amplitude2_deg: Option<f64>,
    pub phase2_deg: Option<f64>,
    /// Amplitude of the torque, N m.
    pub torque_nm: Option<f64>,
    /// Mean torque, N m.
    pub mean_nm: Option<f64>,
}

impl CommandConfig {
    /// Returns whether the command is that of a torque.
    pub(super) fn is_torque(&self) -> bool {
        self.torque_nm.is_some() || self.mean_nm.is_some()
    }

    /// Returns the commanded angle, which is zero if a torque is commanded.
    pub(super) fn angle(&self) -> JointCommand {
        let rad = |deg: Option<f64>| deg.unwrap_or_default().to_radians();
        JointCommand {
            offset_rad: rad(self.offset_deg),
            amplitude_rad: rad(self.amplitude_deg),
            phase_rad: rad(self.phase_deg),
            second: self
                .amplitude2_deg
                .map(|deg| SecondHarmonic::new(deg.to_radians(), rad(self.phase2_deg))),
        }
    }

    /// Returns the commanded torque, which is zero if an angle is commanded.
    pub(super) fn torque(&self) -> TorqueCommand {
        TorqueCommand {
            mean_nm: self.mean_nm.unwrap_or_default(),
            amplitude_nm: self.torque_nm.unwrap_or_default(),
            phase_rad: self.phase_deg.unwrap_or_default().to_radians(),
        }
    }
}

impl GaitConfig {
    /// Returns the commands of the joints from front to rear; `None` for a joint without a command.
    pub fn joints(&self) -> [Option<&CommandConfig>; MAX_JOINTS] {
        let Self { joint1, joint2, joint3, joint4, joint5, joint6, joint7, rotor: _ } = self;
        [joint1, joint2, joint3, joint4, joint5, joint6, joint7].map(Option::as_ref)
    }

    /// Returns mutable access to [`GaitConfig::joints`].
    pub fn joints_mut(&mut self) -> [Option<&mut CommandConfig>; MAX_JOINTS] {
        let Self { joint1, joint2, joint3, joint4, joint5, joint6, joint7, rotor: _ } = self;
        [joint1, joint2, joint3, joint4, joint5, joint6, joint7].map(Option::as_mut)
    }

    /// Returns the commands of the first two joints, in radians: the gait of a robot of three links.
    pub fn to_gait(&self) -> Gait {
        Gait {
            joints: [&self.joint1, &self.joint2].map(|of| of.as_ref().map(CommandConfig::angle)),
        }
    }
}
