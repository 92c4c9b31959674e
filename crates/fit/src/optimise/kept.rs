//! The optima that the page shows, in tables of their own.

use std::path::Path;

use trilink_robot::Model;
use trilink_tables::{
    Objective, OptimumMapRow, OptimumRow, Provenance, Reader, StoreError, hash, table_set,
};

/// Optima with the maps about the best of them.
#[derive(Debug, Clone, Default)]
pub struct Kept {
    pub optima: Vec<OptimumRow>,
    pub maps: Vec<OptimumMapRow>,
}

table_set! {
    Kept by (String, Objective, Model): row => (row.campaign.clone(), row.objective, row.model);
    optima: "optima.parquet",
    maps: "optimum_maps.parquet",
}

impl Kept {
    /// Puts them into the tables of `derived/`, in the place of those of the same campaign, objective and model. Gives why what
    /// the tables had cannot be kept, if they are of another version.
    ///
    /// # Errors
    /// A table cannot be read or written.
    pub fn keep(self, derived: &Path) -> Result<Option<StoreError>, StoreError> {
        let (known, problem) = match Self::read(derived, &Reader::default()) {
            Ok(known) => (known, None),
            Err(error) if error.is_not_there() => (Self::default(), None),
            Err(error) if error.is_schema_mismatch() => (Self::default(), Some(error)),
            Err(error) => return Err(error),
        };
        let mut all = known.by_target();
        all.extend(self.by_target());
        let mut tables = Self::default();
        all.into_values().for_each(|of_one| tables.extend(of_one));
        let input = hash(format!("{tables:?}").as_bytes());
        tables.write(derived, &Provenance { input })?;
        Ok(problem)
    }
}

#[cfg(test)]
mod tests {
    use trilink_tables::Columns;

    use super::*;

    fn of(campaign: &str, objective: Objective, value: f64) -> Kept {
        let campaign = campaign.to_owned();
        let model = Model::SKID_ROLL;
        let map = OptimumMapRow {
            campaign: campaign.clone(),
            model,
            objective,
            value,
            ..OptimumMapRow::blank()
        };
        let best = OptimumRow { campaign, model, objective, value, ..OptimumRow::blank() };
        let maps = vec![map];
        Kept { optima: vec![best.clone(), OptimumRow { rank: 2, ..best }], maps }
    }

    #[test]
    fn optima_take_the_place_of_those_of_the_same_campaign_objective_and_model() {
        let folder = tempfile::tempdir().expect("a folder");
        let derived = folder.path();
        let values = || -> Vec<(String, f64)> {
            let kept = Kept::read(derived, &Reader::default()).expect("tables");
            kept.optima.into_iter().map(|row| (row.campaign, row.value)).collect()
        };
        let keep = |kept: Kept| kept.keep(derived).expect("kept");
        assert!(keep(of("b", Objective::Speed, 1.0)).is_none());
        assert!(keep(of("a", Objective::Speed, 2.0)).is_none());
        assert!(keep(of("a", Objective::Distance, 3.0)).is_none());
        let mut fewer = of("a", Objective::Speed, 4.0);
        fewer.optima.truncate(1);
        assert!(keep(fewer).is_none());
        let (a, b) = ("a".to_owned(), "b".to_owned());
        let expected = [(&a, 3.0), (&a, 3.0), (&a, 4.0), (&b, 1.0), (&b, 1.0)];
        assert_eq!(values(), expected.map(|(name, value)| (name.clone(), value)));
        // A table of another version is said, and what cannot be read is not lost.
        trilink_tables::StartRow::to_table(&[])
            .write(&derived.join("optima.parquet"), &Provenance { input: String::new() })
            .expect("another table");
        assert!(keep(of("b", Objective::Speed, 5.0)).is_some());
        std::fs::write(derived.join("optima.parquet"), "no table").expect("a file");
        assert!(of("b", Objective::Speed, 6.0).keep(derived).is_err());
        assert_eq!(std::fs::read(derived.join("optima.parquet")).expect("a file"), b"no table");
    }
}
