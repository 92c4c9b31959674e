//! Contradictions of a model or of the configuration by a joint-release or coast-down trial.

use trilink_base::named;
use trilink_base::text::known;
use trilink_robot::Model;

use super::verdict;

named! {
    /// Kind of contradiction between a trial and the model or the configuration.
    pub enum ContradictionKind {
        /// The trial shows a resistance that the model lacks.
        MissingLaw = "missing-law",
        /// The trial measures a value that differs from the configured one.
        WrongNumber = "wrong-number",
    }
}

named! {
    /// Kind of resistance to a motion.
    pub enum Resistance {
        ViscousRoll = "viscous roll resistance",
        DryRoll = "dry friction of rolling",
        DryJoint = "dry friction of the joint",
    }
}

verdict! {
    /// Contradiction of a model or of the robot's configuration by a joint-release or coast-down trial.
    #[derive(serde::Serialize)]
    pub struct Contradiction {
        pub kind: ContradictionKind as "",
        pub trial: String as "_trial",
        /// Kinds of resistance that the model lacks.
        pub missing: Vec<Resistance> as "_missing",
        /// Name of the configured robot whose value is contradicted.
        pub robot: String as "_robot",
        /// Symbol of the contradicted quantity.
        pub quantity: String as "_quantity",
        pub unit: String as "_unit",
        pub measured: f64 as "_measured",
        pub configured: f64 as "_configured",
    }
}

impl Contradiction {
    /// Formats this contradiction of `model` as a sentence; empty if a number that the sentence would state is missing.
    pub fn sentence(&self, model: Model) -> String {
        let Self { kind, trial, missing, robot, quantity, unit, measured, configured } = self;
        match kind {
            ContradictionKind::MissingLaw => {
                let missing: Vec<&str> = missing.iter().map(|one| one.name()).collect();
                format!("trial {trial} shows {}, which model {model} lacks", missing.join(" and "))
            }
            ContradictionKind::WrongNumber => {
                known([*measured, *configured], |[measured, configured]| {
                    format!(
                        "trial {trial} measures {quantity} = {measured:.4} {unit}, but {configured:.4} {unit} is \
                         configured: the configured value, the masses or the moments of inertia of robot.{robot} may \
                         be wrong"
                    )
                })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::stored;
    use super::*;

    #[test]
    fn every_contradiction_survives_a_round_trip_and_has_a_sentence() {
        let all = ContradictionKind::ALL.map(|kind| Contradiction {
            kind,
            trial: "push".to_owned(),
            missing: Resistance::ALL.to_vec(),
            robot: "ours".to_owned(),
            quantity: "sum c_R".to_owned(),
            unit: "kg/s".to_owned(),
            measured: 1.375,
            configured: 1.2,
        });
        let [missing, wrong] = all.each_ref().map(|one| one.sentence(Model::SKID_ROLL));
        assert_eq!(
            missing,
            "trial push shows viscous roll resistance and dry friction of rolling and dry friction of \
             the joint, which model skid-roll lacks"
        );
        assert_eq!(
            wrong,
            "trial push measures sum c_R = 1.3750 kg/s, but 1.2000 kg/s is configured: the configured value, the \
             masses \
             or the moments of inertia of robot.ours may be wrong"
        );
        stored(&all.into_iter().map(Some).chain([None]).collect::<Vec<_>>());
    }
}
