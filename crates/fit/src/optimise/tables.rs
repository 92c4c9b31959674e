//! Tables of optima that the report shows.

use std::path::Path;

use trilink_robot::Model;
use trilink_tables::{
    Objective, OptimumMapRow, OptimumRow, Provenance, Reader, StoreError, hash, table_set,
};

/// Optima, and maps of the objective around the best optima.
#[derive(Debug, Clone, Default)]
pub struct OptimaTables {
    pub optima: Vec<OptimumRow>,
    pub maps: Vec<OptimumMapRow>,
}

table_set! {
    OptimaTables by (String, Objective, Model): row => (row.campaign.clone(), row.objective, row.model);
    optima: "optima.parquet",
    maps: "optimum_maps.parquet",
}

impl OptimaTables {
    /// Merges the optima into the tables in `derived/`, where they replace rows for the same campaign, objective and
    /// model. Existing tables of another version are replaced, and the reason is returned.
    ///
    /// # Errors
    /// Returns an error if a table cannot be read or written.
    pub fn merge_into(self, derived: &Path) -> Result<Option<StoreError>, StoreError> {
        let (known, problem) = match Self::read(derived, &Reader::default()) {
            Ok(known) => (known, None),
            Err(error) if error.is_not_there() => (Self::default(), None),
            Err(error) if error.is_schema_mismatch() => (Self::default(), Some(error)),
            Err(error) => return Err(error),
        };
        let mut all = known.by_target();
        all.extend(self.by_target());
        let mut tables = Self::default();
        all.into_values().for_each(|target| tables.extend(target));
        let input = hash(format!("{tables:?}").as_bytes());
        tables.write(derived, &Provenance { input })?;
        Ok(problem)
    }
}

#[cfg(test)]
mod tests {
    use trilink_tables::Columns;

    use super::*;

    fn tables(campaign: &str, objective: Objective, value: f64) -> OptimaTables {
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
        OptimaTables { optima: vec![best.clone(), OptimumRow { rank: 2, ..best }], maps }
    }

    #[test]
    fn optima_replace_those_of_the_same_campaign_objective_and_model() {
        let folder = tempfile::tempdir().expect("a folder");
        let derived = folder.path();
        let values = || -> Vec<(String, f64)> {
            let kept = OptimaTables::read(derived, &Reader::default()).expect("tables");
            kept.optima.into_iter().map(|row| (row.campaign, row.value)).collect()
        };
        let merge = |new: OptimaTables| new.merge_into(derived).expect("the tables are written");
        assert!(merge(tables("b", Objective::Speed, 1.0)).is_none());
        assert!(merge(tables("a", Objective::Speed, 2.0)).is_none());
        assert!(merge(tables("a", Objective::Distance, 3.0)).is_none());
        let mut fewer = tables("a", Objective::Speed, 4.0);
        fewer.optima.truncate(1);
        assert!(merge(fewer).is_none());
        let expected = [("a", 3.0), ("a", 3.0), ("a", 4.0), ("b", 1.0), ("b", 1.0)];
        assert_eq!(values(), expected.map(|(name, value)| (name.to_owned(), value)));
        // A table of another version is replaced and reported; a file that cannot be read is not overwritten.
        trilink_tables::StartRow::to_table(&[])
            .write(&derived.join("optima.parquet"), &Provenance { input: String::new() })
            .expect("another table");
        assert!(merge(tables("b", Objective::Speed, 5.0)).is_some());
        std::fs::write(derived.join("optima.parquet"), "no table").expect("a file");
        assert!(tables("b", Objective::Speed, 6.0).merge_into(derived).is_err());
        assert_eq!(std::fs::read(derived.join("optima.parquet")).expect("a file"), b"no table");
    }
}
