//! What a trial of another kind tells against a model or the configuration.

use trilink_base::named;
use trilink_base::text::known;
use trilink_robot::Model;

use super::verdict;

named! {
    /// What a contradiction is.
    pub enum ContradictionKind {
        /// The trial shows resistances that the model has not.
        MissingLaw = "missing-law",
        /// It measures something else than is configured.
        WrongNumber = "wrong-number",
    }
}

named! {
    /// What resists a motion.
    pub enum Resistance {
        ViscousRoll = "viscous roll resistance",
        DryRoll = "dry friction of rolling",
        DryJoint = "dry friction of the joint",
    }
}

verdict! {
    /// What a joint-release or coast-down tells of its robot that the model has not, or that is not what is
    /// configured.
    #[derive(serde::Serialize)]
    pub struct Contradiction {
        pub kind: ContradictionKind as "",
        pub trial: String as "_trial",
        /// What the model lacks.
        pub missing: Vec<Resistance> as "_missing",
        /// The robot of the configuration of which a number is off, and which: its symbol and unit.
        pub robot: String as "_robot",
        pub quantity: String as "_quantity",
        pub unit: String as "_unit",
        pub measured: f64 as "_measured",
        pub configured: f64 as "_configured",
    }
}

impl Contradiction {
    /// The sentence on it beside a model; empty where its numbers are missing.
    pub fn sentence(&self, model: Model) -> String {
        let Self { kind, trial, missing, robot, quantity, unit, measured, configured } = self;
        match kind {
            ContradictionKind::MissingLaw => {
                let missing: Vec<&str> = missing.iter().map(|of| of.name()).collect();
                format!("{trial} shows {}, and {model} has none", missing.join(" and "))
            }
            ContradictionKind::WrongNumber => known([*measured, *configured], |[found, known]| {
                format!(
                    "{trial} measures {quantity} {found:.4} {unit} where {known:.4} is configured: \
                     that, the masses or the moments of inertia of robot.{robot} may be wrong"
                )
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::stored;
    use super::*;

    #[test]
    fn every_contradiction_is_read_as_it_was_written_and_said_in_a_sentence() {
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
            "push shows viscous roll resistance and dry friction of rolling and dry friction of \
             the joint, and skid-roll has none"
        );
        assert_eq!(
            wrong,
            "push measures sum c_R 1.3750 kg/s where 1.2000 is configured: that, the masses or the \
             moments of inertia of robot.ours may be wrong"
        );
        stored(&all.into_iter().map(Some).chain([None]).collect::<Vec<_>>());
    }
}
