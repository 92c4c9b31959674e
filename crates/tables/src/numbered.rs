//! Values of the links, wheels or joints of robots whose numbers of links differ.

use std::ops::{Deref, DerefMut};

use polars::prelude::Column;
use serde::Serialize;

use crate::columns::fill;
use crate::{Columns, Frames, StoreError, Table};

/// Values of links, wheels or joints, one per number from `FIRST` on, in columns that bear these numbers.
///
/// A table has columns up to the highest number of any row; they are missing where a robot has no such part.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Numbered<T, const FIRST: usize>(pub Vec<T>);

/// Values of links or of their wheels, numbered from 0; link 0 is the reference link.
pub type ByLink<T> = Numbered<T, 0>;

/// Values of joints, numbered from 1, from front to rear.
pub type ByJoint<T> = Numbered<T, 1>;

impl<T, const FIRST: usize> Default for Numbered<T, FIRST> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T, const FIRST: usize> Deref for Numbered<T, FIRST> {
    type Target = Vec<T>;

    fn deref(&self) -> &Vec<T> {
        &self.0
    }
}

impl<T, const FIRST: usize> DerefMut for Numbered<T, FIRST> {
    fn deref_mut(&mut self) -> &mut Vec<T> {
        &mut self.0
    }
}

impl<T, const FIRST: usize, const N: usize> From<[T; N]> for Numbered<T, FIRST> {
    fn from(values: [T; N]) -> Self {
        Self(values.into())
    }
}

impl<T, const FIRST: usize> FromIterator<T> for Numbered<T, FIRST> {
    fn from_iter<I: IntoIterator<Item = T>>(values: I) -> Self {
        Self(values.into_iter().collect())
    }
}

impl<T, const FIRST: usize> IntoIterator for Numbered<T, FIRST> {
    type Item = T;
    type IntoIter = std::vec::IntoIter<T>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.into_iter()
    }
}

impl<T: Clone, const FIRST: usize> Numbered<T, FIRST> {
    /// Returns the first `N` values; those that are absent are `absent`.
    pub fn into_array_or<const N: usize>(self, absent: T) -> [T; N] {
        let mut values = self.into_iter();
        std::array::from_fn(|_| values.next().unwrap_or_else(|| absent.clone()))
    }
}

/// Returns the column-name patterns of the parts from `FIRST` on that a table has.
fn patterns<'t>(
    table: &'t Table,
    pattern: &'t str,
    first: usize,
) -> impl Iterator<Item = String> + 't {
    (first..).map(move |number| fill(pattern, &number.to_string())).take_while(|pattern| {
        let start = pattern.split("{}").next().unwrap_or_default();
        let is_of_part =
            |name: &str| name == start || pattern.len() > start.len() && name.starts_with(start);
        table.frame.get_column_names().into_iter().any(|name| is_of_part(name))
    })
}

impl<T: Columns, const FIRST: usize> Columns for Numbered<T, FIRST> {
    fn blank() -> Self {
        Self::default()
    }

    fn write(values: &[&Self], pattern: &str, columns: &mut Vec<Column>) {
        let count = values.iter().map(|values| values.len()).max().unwrap_or(0);
        let blank = T::blank();
        for i in 0..count {
            let parts: Vec<&T> =
                values.iter().map(|values| values.get(i).unwrap_or(&blank)).collect();
            T::write(&parts, &fill(pattern, &(FIRST + i).to_string()), columns);
        }
    }

    fn read(table: &Table, pattern: &str) -> Result<Vec<Self>, StoreError> {
        let parts = patterns(table, pattern, FIRST);
        let parts = parts.map(|pattern| Ok(T::read(table, &pattern)?.into_iter()));
        let mut parts = parts.collect::<Result<Vec<_>, StoreError>>()?;
        let row = |_| parts.iter_mut().filter_map(Iterator::next).collect();
        Ok((0..table.len()).map(row).collect())
    }
}

impl<S: Frames, const FIRST: usize> Frames for Numbered<S, FIRST> {
    fn write(self, pattern: &str, columns: &mut Vec<Column>) {
        for (number, element) in (FIRST..).zip(self) {
            element.write(&fill(pattern, &number.to_string()), columns);
        }
    }

    /// A table without the first part is an error.
    fn read(table: &Table, pattern: &str) -> Result<Self, StoreError> {
        let first = S::read(table, &fill(pattern, &FIRST.to_string()))?;
        let others = patterns(table, pattern, FIRST + 1).map(|pattern| S::read(table, &pattern));
        std::iter::once(Ok(first)).chain(others).collect::<Result<_, _>>().map(Self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{frames, rows};

    rows! {
        /// Row of a robot.
        pub struct Robot {
            pub sigma: [f64; 3] as "sigma{}",
            pub more_sigma: Numbered<f64, 3> as "sigma{}" after "sigma2",
            pub mass: f64,
        }
    }

    frames! {
        /// Series of a robot.
        #[allow(unreachable_pub)]
        pub struct Series {
            pub skid_m_s: ByLink<Vec<f64>> as "skid{}_m_s",
            pub phi_rad: ByJoint<Vec<f64>> as "phi{}_rad",
        }
    }

    fn names(table: &Table) -> Vec<String> {
        table.frame.get_column_names().into_iter().map(|name| name.to_string()).collect()
    }

    fn robot(more: &[f64]) -> Robot {
        Robot { sigma: [0.0, 0.1, 0.2], more_sigma: Numbered(more.to_vec()), mass: 1.5 }
    }

    #[test]
    fn a_table_has_columns_up_to_the_longest_robot_that_are_null_for_the_others() {
        let three = Robot::to_table(&[robot(&[])]);
        assert_eq!(names(&three), ["sigma0", "sigma1", "sigma2", "mass"]);
        assert_eq!(Robot::from_table(&three).unwrap(), [robot(&[])]);
        let mixed = Robot::to_table(&[robot(&[]), robot(&[0.3, 0.4])]);
        assert_eq!(names(&mixed)[2..], ["sigma2", "sigma3", "sigma4", "mass"]);
        assert_eq!(mixed.frame.column("sigma4").unwrap().null_count(), 1);
        let rows = Robot::from_table(&mixed).unwrap();
        assert_eq!(rows[1], robot(&[0.3, 0.4]));
        assert!(rows[0].more_sigma.iter().all(|sigma| sigma.is_nan()));
    }

    #[test]
    fn series_are_read_as_they_were_written_and_the_first_must_be_there() {
        for links in [2, 3, 8_usize] {
            let of_links = |first: usize| (first..links).map(|link| vec![link as f64; 4]).collect();
            let series = Series { skid_m_s: Numbered(of_links(0)), phi_rad: Numbered(of_links(1)) };
            let table = series.clone().into_table("a");
            assert_eq!(names(&table).last().unwrap(), &format!("phi{}_rad", links - 1));
            assert_eq!(Series::from_table(&table).unwrap(), series);
            let frame = table.frame.drop("phi1_rad").unwrap();
            let error = Series::from_table(&Table { frame, ..table }).unwrap_err();
            assert!(error.to_string().contains("phi1_rad"), "{error}");
        }
    }
}
