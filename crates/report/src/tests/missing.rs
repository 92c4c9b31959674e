//! Tests of the report page with each numeric column of a table missing in turn.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use polars::prelude::{Column, DataType};
use rayon::prelude::*;
use trilink_tables::{Columns, Reader, Table};

use super::{MadeUp, ReportInput, config, temporary};
use crate::page::{Remarks, html};
use crate::tables::Tables;

/// Returns, for each numeric column, the name of the column and a copy of the rows with all values of that column
/// missing.
fn with_each_number_missing<R: Columns>(rows: &[R]) -> Vec<(String, Vec<R>)> {
    let Table { frame, .. } = R::to_table(rows);
    frame
        .columns()
        .iter()
        .filter(|column| *column.dtype() == DataType::Float64)
        .map(|column| {
            let mut frame = frame.clone();
            let missing = Column::full_null(column.name().clone(), rows.len(), &DataType::Float64);
            frame.with_column(missing).expect("of the same height");
            let table = Table { frame, ..R::to_table(&[]) };
            (column.name().to_string(), R::from_table(&table).expect("the same columns"))
        })
        .collect()
}

/// Function that replaces the rows of a table.
type Put<R> = fn(&mut Tables, Vec<R>);

fn check<R: Columns + Send + Sync>(
    derived: &Path,
    input: &ReportInput,
    rows: fn(&Tables) -> &[R],
    put: Put<R>,
) {
    let tables = || Tables::read(derived, &Reader::default()).expect("reads");
    let all = with_each_number_missing(rows(&tables()));
    assert!(!all.is_empty());
    all.into_par_iter().for_each(|(column, rows)| {
        let mut tables = tables();
        put(&mut tables, rows);
        let remarks = Remarks { missing: &[], truth: None, changes: None };
        let page = html(input, &tables, &[], &BTreeMap::new(), &[], remarks).expect("a page");
        let body = page.split("<script").next().unwrap_or_default();
        let texts = body.split('<').filter(|text| !text.contains("data-points="));
        for text in texts {
            let mut words = text.split(|c: char| !c.is_alphanumeric() && c != '-');
            assert!(
                !words.any(|word| ["NaN", "nan", "inf", "-inf"].contains(&word)),
                "without {column}: {text}"
            );
        }
    });
}

#[test]
fn missing_values_are_not_printed() {
    let folder = temporary();
    let derived = folder.path().join("derived");
    MadeUp::of_the_paper().write(&derived);
    let input = ReportInput::new(&config(folder.path()), BTreeSet::new());
    check(&derived, &input, |of| &of.trials, |of, rows| of.trials = rows);
    check(&derived, &input, |of| &of.fits, |of, rows| of.fits = rows);
    check(&derived, &input, |of| &of.alternative_fits, |of, rows| of.alternative_fits = rows);
    check(&derived, &input, |of| &of.shared_fits, |of, rows| of.shared_fits = rows);
    check(&derived, &input, |of| &of.comparison, |of, rows| of.comparison = rows);
    check(&derived, &input, |of| &of.robots, |of, rows| of.robots = rows);
}
