//! Current time, for results that state when they were computed.

use std::time::{SystemTime, UNIX_EPOCH};

/// Returns the current UTC time to the second, such as `2026-11-12T02:31:07Z`.
pub fn utc_now() -> String {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    let seconds = since.map_or(0, |since| since.as_secs() as i64);
    let time = chrono::DateTime::from_timestamp(seconds, 0).unwrap_or_default();
    time.format("%Y-%m-%dT%H:%M:%SZ").to_string()
}
