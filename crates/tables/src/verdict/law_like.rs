//! A law that the trials do not tell from another one.

use std::fmt::{self, Display, Formatter};

use trilink_base::named;
use trilink_base::text::known;

use super::{serialize_as_sentence, verdict};

/// Part of the transition speed v_t up to which tanh is within 5 % of its argument.
pub const LINEAR_PART: f64 = 0.4;

named! {
    /// What a law with dry friction comes to where no wheel skids faster than [`LINEAR_PART`] of its
    /// transition speed.
    pub enum LawKind {
        /// Its friction moves no metric by its noise.
        Constrained = "constrained",
        Viscous = "viscous",
    }
}

verdict! {
    /// The law that a law with dry friction is like at all of the trials' motions.
    pub struct LawLike {
        pub kind: LawKind as "",
        /// F / v_t of the wheels.
        pub viscous_kg_s: [f64; 3] as "{}_kg_s",
    }
}

impl Display for LawLike {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        let below = format!("no wheel skids faster than {LINEAR_PART} times the transition speed");
        match self.kind {
            LawKind::Constrained => {
                write!(f, "constrained: {below}, and F moves nothing by its noise")
            }
            LawKind::Viscous => {
                let same = known(self.viscous_kg_s, |[of0, of1, of2]| {
                    format!(" with F / v_t = {of0:.4}, {of1:.4}, {of2:.4} kg/s")
                });
                write!(f, "viscous{same}: {below}")
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
    fn every_law_is_read_as_it_was_written_and_said_in_a_sentence() {
        let all = LawKind::ALL.map(|kind| Some(LawLike { kind, viscous_kg_s: [1.5, 2.0, 300.0] }));
        let [constrained, viscous] = all.clone().map(|law| law.expect("a law").to_string());
        let table = stored(&[&all[..], &[None]].concat());
        let names = ["of", "of0_kg_s", "of1_kg_s", "of2_kg_s"];
        assert_eq!(table.frame.get_column_names(), names);
        let below = "no wheel skids faster than 0.4 times the transition speed";
        assert_eq!(constrained, format!("constrained: {below}, and F moves nothing by its noise"));
        let same = "1.5000, 2.0000, 300.0000";
        assert_eq!(viscous, format!("viscous with F / v_t = {same} kg/s: {below}"));
    }
}
