//! Times of day in tables.

use std::fmt;
use std::ops::Deref;

use chrono::{DateTime, SecondsFormat};
use polars::prelude::{
    AnyValue, Column, DataType, Int64Chunked, IntoColumn, IntoSeries, NewChunkedArray, TimeUnit,
    TimeZone,
};

use super::{Columns, StoreError, Table};

/// A time such as `2026-11-12T02:31:07Z`, UTC; in tables a timestamp in milliseconds. Empty where
/// none is known.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct UtcTime(String);

impl UtcTime {
    /// From text, if it is a time.
    pub fn parse(text: &str) -> Option<Self> {
        Self::of_ms(DateTime::parse_from_rfc3339(text).ok()?.timestamp_millis())
    }

    /// Milliseconds since 1970.
    fn of_ms(ms: i64) -> Option<Self> {
        let time = DateTime::from_timestamp_millis(ms)?;
        Some(Self(time.to_rfc3339_opts(SecondsFormat::AutoSi, true)))
    }

    fn ms(&self) -> Option<i64> {
        Some(DateTime::parse_from_rfc3339(&self.0).ok()?.timestamp_millis())
    }
}

impl Deref for UtcTime {
    type Target = str;

    fn deref(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for UtcTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self)
    }
}

impl Columns for UtcTime {
    fn blank() -> Self {
        Self::default()
    }

    fn write(values: &[&Self], name: &str, columns: &mut Vec<Column>) {
        let ms = values.iter().map(|time| time.ms());
        let times = Int64Chunked::from_iter_options(name.into(), ms);
        let times = times.into_datetime(TimeUnit::Milliseconds, Some(TimeZone::UTC));
        columns.push(times.into_series().into_column());
    }

    /// Text, too, which such columns were.
    fn read(table: &Table, name: &str) -> Result<Vec<Self>, StoreError> {
        const NEEDED: &str = "times";
        if table.frame.column(name).is_ok_and(|column| column.dtype().is_string()) {
            let time = |text: String| {
                if text.is_empty() { Some(Self::default()) } else { Self::parse(&text) }
                    .ok_or_else(|| table.wrong(name, &format!("`{text}`"), NEEDED))
            };
            return String::read(table, name)?.into_iter().map(time).collect();
        }
        let dtype = DataType::Datetime(TimeUnit::Milliseconds, Some(TimeZone::UTC));
        let times = table.column(name, (NEEDED, DataType::is_datetime), &dtype)?;
        let ms = times.datetime().map_err(|error| table.error(&error))?.physical();
        let time = |ms: Option<i64>| match ms {
            None => Ok(Self::default()),
            Some(ms) => Self::of_ms(ms).ok_or_else(|| table.wrong(name, &ms.to_string(), NEEDED)),
        };
        ms.iter().map(time).collect()
    }
}

/// The text of a cell that is a time; one without a zone is taken as it is.
pub fn time_text(cell: &AnyValue) -> Option<String> {
    let AnyValue::Datetime(ticks, unit, zone) = cell else { return None };
    let (per_s, ns) = match unit {
        TimeUnit::Nanoseconds => (1_000_000_000, 1),
        TimeUnit::Microseconds => (1_000_000, 1_000),
        TimeUnit::Milliseconds => (1_000, 1_000_000),
    };
    let part = ticks.rem_euclid(per_s) * ns;
    let time = DateTime::from_timestamp(ticks.div_euclid(per_s), part as u32)?;
    let text = time.to_rfc3339_opts(SecondsFormat::AutoSi, true);
    Some(if zone.is_some() { text } else { text.trim_end_matches('Z').to_owned() })
}

#[cfg(test)]
mod tests {
    use super::*;

    crate::rows! {
        /// A row with a time.
        pub struct Row {
            pub time: UtcTime,
        }
    }

    #[test]
    fn times_are_timestamps_in_milliseconds_and_come_back() {
        let times =
            ["2026-11-12T02:31:07Z", "1969-12-31T23:59:59.250Z", "2026-11-12T02:31:07.001Z"];
        let rows = times.map(|time| Row { time: UtcTime::parse(time).unwrap() });
        let rows = [&rows[..], &[Row::blank()]].concat();
        let table = Row::to_table(&rows);
        let dtype = DataType::Datetime(TimeUnit::Milliseconds, Some(TimeZone::UTC));
        assert_eq!(table.frame.column("time").unwrap().dtype(), &dtype);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("times.parquet");
        let provenance = crate::Provenance { input: String::new() };
        table.write(&path, &provenance).unwrap();
        let read = Table::read(&path).unwrap();
        assert_eq!(read.frame.column("time").unwrap().dtype(), &dtype);
        assert_eq!(Row::from_table(&read).unwrap(), rows);
        for (row, time) in rows.iter().zip(times) {
            assert_eq!(&*row.time, time);
        }
        assert_eq!(&*UtcTime::parse("2026-11-12T03:31:07+01:00").unwrap(), times[0]);
    }

    #[test]
    fn times_of_other_programs_and_former_ones_are_read() {
        let column = |column: Column| Table::new(vec![column.with_name("time".into())]);
        let texts = super::super::texts("", ["2026-11-12T02:31:07Z", ""].into_iter());
        let rows = Row::from_table(&column(texts)).unwrap();
        assert_eq!([&*rows[0].time, &*rows[1].time], ["2026-11-12T02:31:07Z", ""]);
        let of = |unit, per_s: i64| {
            let ticks = Int64Chunked::from_iter_options(
                "".into(),
                [Some(per_s * 86_400), None].into_iter(),
            );
            Row::from_table(&column(ticks.into_datetime(unit, None).into_series().into_column()))
        };
        for (unit, per_s) in
            [(TimeUnit::Microseconds, 1_000_000), (TimeUnit::Nanoseconds, 1_000_000_000)]
        {
            let rows = of(unit, per_s).unwrap();
            assert_eq!([&*rows[0].time, &*rows[1].time], ["1970-01-02T00:00:00Z", ""]);
        }
        let wrong = super::super::texts("", ["yesterday"].into_iter());
        let error = Row::from_table(&column(wrong)).unwrap_err().to_string();
        assert!(error.ends_with("column `time`: found `yesterday`, needed times"), "{error}");
    }
}
