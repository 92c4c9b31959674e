//! UTC times in tables.

use std::fmt;
use std::ops::Deref;

use chrono::{DateTime, SecondsFormat};
use polars::prelude::{
    AnyValue, Column, DataType, Int64Chunked, IntoColumn, IntoSeries, NewChunkedArray, TimeUnit,
    TimeZone,
};

use super::{Columns, StoreError, Table};

/// UTC time such as `2026-11-12T02:31:07Z`, which is stored in tables as a timestamp in milliseconds; empty if unknown.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct UtcTime(String);

impl UtcTime {
    /// Parses an RFC 3339 time; `None` if the text is not one.
    pub fn parse(text: &str) -> Option<Self> {
        Self::from_unix_ms(DateTime::parse_from_rfc3339(text).ok()?.timestamp_millis())
    }

    /// Returns the time `ms` milliseconds after the Unix epoch; `None` if it is out of range.
    fn from_unix_ms(ms: i64) -> Option<Self> {
        let time = DateTime::from_timestamp_millis(ms)?;
        Some(Self(time.to_rfc3339_opts(SecondsFormat::AutoSi, true)))
    }

    fn unix_ms(&self) -> Option<i64> {
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
        let ms = values.iter().map(|time| time.unix_ms());
        let times = Int64Chunked::from_iter_options(name.into(), ms);
        let times = times.into_datetime(TimeUnit::Milliseconds, Some(TimeZone::UTC));
        columns.push(times.into_series().into_column());
    }

    /// Reads times from a column of timestamps, or from a column of text as written by older versions.
    fn read(table: &Table, name: &str) -> Result<Vec<Self>, StoreError> {
        const NEEDED: &str = "times";
        let mut times = Vec::new();
        if table.frame.column(name).is_ok_and(|column| column.dtype().is_string()) {
            for text in String::read(table, name)? {
                let time = if text.is_empty() { Some(Self::default()) } else { Self::parse(&text) };
                times.push(time.ok_or_else(|| table.wrong(name, &format!("`{text}`"), NEEDED))?);
            }
            return Ok(times);
        }
        let dtype = DataType::Datetime(TimeUnit::Milliseconds, Some(TimeZone::UTC));
        let column = table.column(name, (NEEDED, DataType::is_datetime), &dtype)?;
        for ms in column.datetime().map_err(|error| table.error(&error))?.physical().iter() {
            let time = ms.map_or_else(|| Some(Self::default()), Self::from_unix_ms);
            let found = || ms.unwrap_or_default().to_string();
            times.push(time.ok_or_else(|| table.wrong(name, &found(), NEEDED))?);
        }
        Ok(times)
    }
}

/// Formats a cell that holds a time as RFC 3339 text, without `Z` if the cell has no time zone; `None` for other cells.
pub fn time_text(cell: &AnyValue) -> Option<String> {
    let AnyValue::Datetime(ticks, unit, zone) = cell else { return None };
    let (ticks_per_s, ns_per_tick) = match unit {
        TimeUnit::Nanoseconds => (1_000_000_000, 1),
        TimeUnit::Microseconds => (1_000_000, 1_000),
        TimeUnit::Milliseconds => (1_000, 1_000_000),
    };
    let ns = ticks.rem_euclid(ticks_per_s) * ns_per_tick;
    let time = DateTime::from_timestamp(ticks.div_euclid(ticks_per_s), ns as u32)?;
    let text = time.to_rfc3339_opts(SecondsFormat::AutoSi, true);
    Some(if zone.is_some() { text } else { text.trim_end_matches('Z').to_owned() })
}

#[cfg(test)]
mod tests {
    use super::*;

    crate::rows! {
        /// Row with a time.
        pub struct Row {
            pub time: UtcTime,
        }
    }

    #[test]
    fn times_are_stored_as_timestamps_in_milliseconds_and_read_back() {
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
    fn times_written_by_other_programs_and_older_versions_are_read() {
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
