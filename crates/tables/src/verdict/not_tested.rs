//! Why nobody knows whether campaigns share their coefficients.

use std::fmt::{self, Display, Formatter};

use trilink_base::named;

use super::{serialize_as_sentence, verdict};

named! {
    /// What keeps sharing from being tested.
    pub enum NotTestedReason {
        /// This campaign has no trial with metrics.
        NoTrials = "no-trials",
        /// One campaign leaves this sum free, and another this part of it.
        PartOfFree = "part-of-free",
        /// No model of a campaign has all motions.
        NoWholeModel = "no-whole-model",
        SharedFitFailed = "shared-fit-failed",
        /// That of this campaign.
        FitFailed = "fit-failed",
        /// This campaign does not leave free what the others do.
        OtherFree = "other-free",
        /// The fits leave nothing that would tell the noise.
        NothingLeft = "nothing-left",
        /// A separate fit is not at its lowest objective.
        NotLowest = "not-lowest",
        /// This campaign has fewer than [`NotTested::LEAST_BLOCKS`].
        FewBlocks = "few-blocks",
        /// The shared fit lacks one.
        NoMotion = "no-motion",
    }
}

verdict! {
    /// Why sharing is neither kept nor refused.
    pub struct NotTested {
        pub reason: NotTestedReason as "",
        /// The campaign, or the sum and its part.
        pub of: Vec<String> as "_of",
        /// Blocks of frequencies that the campaign has.
        pub blocks: Option<i64> as "_blocks",
    }
}

impl From<NotTestedReason> for NotTested {
    fn from(reason: NotTestedReason) -> Self {
        Self { reason, of: Vec::new(), blocks: None }
    }
}

impl NotTested {
    /// Blocks of frequencies that a campaign needs: fewer signs give too few worlds.
    pub const LEAST_BLOCKS: usize = 4;

    /// For a reason that is about a campaign.
    pub fn of(reason: NotTestedReason, campaign: &str) -> Self {
        Self { of: vec![campaign.to_owned()], ..reason.into() }
    }
}

impl Display for NotTested {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        use NotTestedReason as Reason;
        let of = |nth: usize| self.of.get(nth).map_or("", String::as_str);
        let campaign = of(0);
        match self.reason {
            Reason::NoTrials => write!(f, "campaign {campaign} has no trial with metrics"),
            Reason::PartOfFree => write!(
                f,
                "one campaign leaves {} free, and another {}, which is part of it",
                of(0),
                of(1)
            ),
            Reason::NoWholeModel => f.write_str("no model of a campaign has all motions"),
            Reason::SharedFitFailed => f.write_str("the shared fit has failed"),
            Reason::FitFailed => write!(f, "the fit of campaign {campaign} has failed"),
            Reason::OtherFree => {
                write!(f, "campaign {campaign} does not leave free what the others do")
            }
            Reason::NothingLeft => f.write_str("the fits leave nothing that would tell the noise"),
            Reason::NotLowest => f.write_str("a separate fit is not at its lowest objective"),
            Reason::FewBlocks => write!(
                f,
                "campaign {campaign} has {} blocks of frequencies, and {} are needed",
                self.blocks.unwrap_or_default(),
                Self::LEAST_BLOCKS
            ),
            Reason::NoMotion => f.write_str("a motion of the shared fit does not exist"),
        }
    }
}

serialize_as_sentence!(NotTested);

#[cfg(test)]
mod tests {
    use super::super::tests::stored;
    use super::*;

    #[test]
    fn every_reason_is_read_as_it_was_written_and_said_in_a_sentence() {
        let of = vec!["ours".to_owned(), "theirs".to_owned()];
        let all = NotTestedReason::ALL.map(|reason| {
            let blocks = (reason == NotTestedReason::FewBlocks).then_some(2);
            NotTested { reason, of: of.clone(), blocks }
        });
        let said = all.each_ref().map(NotTested::to_string);
        assert_eq!(said.iter().collect::<std::collections::BTreeSet<_>>().len(), said.len());
        assert_eq!(said[8], "campaign ours has 2 blocks of frequencies, and 4 are needed");
        let table = stored(&all.into_iter().map(Some).chain([None]).collect::<Vec<_>>());
        assert_eq!(table.frame.get_column_names(), ["of", "of_of", "of_blocks"]);
    }
}
