//! Simpler law from which the trials cannot distinguish a law with dry friction.

use std::fmt::{self, Display, Formatter};

use trilink_base::named;

use super::{serialize_as_sentence, verdict};
use crate::Numbered;

/// Fraction of the transition speed v_t up to which tanh(v / v_t) is within 5 % of its argument.
pub const LINEAR_PART: f64 = 0.4;

named! {
    /// Simpler law to which a law with dry friction reduces if no wheel skids faster than the fraction
    /// [`LINEAR_PART`] of the transition speed.
    pub enum LawKind {
        /// Practically no skidding: the dry friction is so large that changing it affects every metric by less than the
        /// noise.
        Constrained = "constrained",
        Viscous = "viscous",
    }
}

verdict! {
    /// Simpler law that is equivalent to a law with dry friction in the motions of all trials.
    pub struct LawLike {
        pub kind: LawKind as "",
        /// Equivalent viscous skid coefficients F / v_t of wheels 0, 1, 2, where F is the dry or static friction and
        /// v_t the transition speed; missing for a link without a wheel.
        pub viscous_kg_s: [f64; 3] as "{}_kg_s",
        /// The coefficients of wheels 3, 4, .. of a chain.
        pub more_viscous_kg_s: Numbered<f64, 3> as "{}_kg_s",
    }
}

impl Display for LawLike {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        let below = format!("no wheel skids faster than {LINEAR_PART} times the transition speed");
        match self.kind {
            LawKind::Constrained => {
                write!(
                    f,
                    "constrained: {below}, and the effect of the dry friction F is below the noise"
                )
            }
            LawKind::Viscous => {
                let all = self.viscous_kg_s.iter().chain(&*self.more_viscous_kg_s);
                let known: Vec<String> =
                    all.filter(|of| of.is_finite()).map(|of| format!("{of:.4}")).collect();
                match known[..] {
                    [] => write!(f, "viscous: {below}"),
                    _ => write!(f, "viscous with F / v_t = {} kg/s: {below}", known.join(", ")),
                }
            }
        }
    }
}

serialize_as_sentence!(LawLike);

#[cfg(test)]
mod tests {
    use super::super::tests::stored;
    use super::*;

    #[test]
    fn every_law_survives_a_round_trip_and_has_a_sentence() {
        let law = |kind| LawLike {
            kind,
            viscous_kg_s: [1.5, 2.0, 300.0],
            more_viscous_kg_s: Numbered::default(),
        };
        let all = LawKind::ALL.map(|kind| Some(law(kind)));
        let [constrained, viscous] = all.clone().map(|law| law.expect("a law").to_string());
        let table = stored(&[&all[..], &[None]].concat());
        let names = ["of", "of0_kg_s", "of1_kg_s", "of2_kg_s"];
        assert_eq!(table.frame.get_column_names(), names);
        let below = "no wheel skids faster than 0.4 times the transition speed";
        let no_effect = "and the effect of the dry friction F is below the noise";
        assert_eq!(constrained, format!("constrained: {below}, {no_effect}"));
        let coefficients = "1.5000, 2.0000, 300.0000";
        assert_eq!(viscous, format!("viscous with F / v_t = {coefficients} kg/s: {below}"));

        let chain = LawLike {
            viscous_kg_s: [1.5, f64::NAN, 300.0],
            more_viscous_kg_s: [4.0].into(),
            ..law(LawKind::Viscous)
        };
        let sentence = chain.to_string();
        let table = stored(&[None, Some(LawLike { viscous_kg_s: [1.5; 3], ..chain })]);
        assert_eq!(table.frame.get_column_names(), [&names[..], &["of3_kg_s"]].concat());
        let coefficients = "1.5000, 300.0000, 4.0000";
        assert_eq!(sentence, format!("viscous with F / v_t = {coefficients} kg/s: {below}"));
    }
}
