//! What a file was when it was last looked at, so that unchanged ones are not read again.

use std::fs::Metadata;
use std::io;
use std::path::Path;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

/// Clocks of file systems tick this coarsely at most; those that count whole seconds are told by
/// their times.
const TICK: Duration = Duration::from_millis(20);
const COARSE_TICK: Duration = Duration::from_secs(2);

/// Size, time and content of a file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stamp {
    pub bytes: u64,
    /// Of the last change, ns since 1970. Missing where a later change might have the same time:
    /// then the file is read again the next time.
    pub modified_ns: Option<u64>,
    /// Of the content, in hexadecimal.
    pub blake3: String,
}

impl Stamp {
    /// The stamp of a file somebody else may write, of which `content` was read after `metadata`.
    pub fn of_input(metadata: &Metadata, content: &[u8]) -> Self {
        let is_whole = metadata.len() == content.len() as u64;
        let modified_ns = modified_ns(metadata).filter(|ns| is_whole && is_past(*ns));
        Self { bytes: metadata.len(), modified_ns, blake3: hash(content) }
    }

    /// The stamp of a file of which only the content is known.
    pub fn of_content(content: &[u8]) -> Self {
        Self { bytes: content.len() as u64, modified_ns: None, blake3: hash(content) }
    }

    /// The stamp of a file that this program wrote, under its lock.
    pub(super) fn of_output(metadata: &Metadata, blake3: String) -> Self {
        Self { bytes: metadata.len(), modified_ns: modified_ns(metadata), blake3 }
    }

    /// [`Stamp::renew`] of a file in a folder that only who holds its lock writes to: however
    /// young the file is, a later change has another time.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn renew_own(path: &Path, known: Option<&Self>, verify: bool) -> io::Result<Self> {
        match known {
            Some(known) if !verify && known.is_current(path) => Ok(known.clone()),
            _ => Ok(Self::of_output(&std::fs::metadata(path)?, hash(&std::fs::read(path)?))),
        }
    }

    /// Whether it says the same as an earlier one, or only more of the file's time.
    pub fn confirms(&self, earlier: &Self) -> bool {
        (self.bytes, &self.blake3) == (earlier.bytes, &earlier.blake3)
            && (earlier.modified_ns.is_none() || earlier.modified_ns == self.modified_ns)
    }

    /// Reads a file that somebody else may write.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn read(path: &Path) -> io::Result<Self> {
        let metadata = std::fs::metadata(path)?;
        Ok(Self::of_input(&metadata, &std::fs::read(path)?))
    }

    /// The stamp of a file that was known as `known`, which is read only if its size or time
    /// differ, or to `verify` it.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn renew(path: &Path, known: Option<&Self>, verify: bool) -> io::Result<Self> {
        match known {
            Some(known) if !verify && known.is_current(path) => Ok(known.clone()),
            _ => Self::read(path),
        }
    }

    /// Whether a file has this size and time.
    pub fn is_current(&self, path: &Path) -> bool {
        let Ok(metadata) = std::fs::metadata(path) else { return false };
        metadata.is_file()
            && metadata.len() == self.bytes
            && self.modified_ns.is_some()
            && modified_ns(&metadata) == self.modified_ns
    }

    /// Whether a file is as it was; to `verify` that, it is read.
    pub fn is_intact(&self, path: &Path, verify: bool) -> bool {
        if verify { self.is_content_of(path) } else { self.is_current(path) }
    }

    /// The text of a file that still has this content.
    pub fn text_of(&self, path: &Path) -> Option<String> {
        let text = std::fs::read_to_string(path).ok()?;
        (hash(text.as_bytes()) == self.blake3).then_some(text)
    }

    /// Whether a file has this content.
    pub fn is_content_of(&self, path: &Path) -> bool {
        std::fs::read(path).is_ok_and(|content| hash(&content) == self.blake3)
    }
}

/// blake3 in hexadecimal.
pub fn hash(content: &[u8]) -> String {
    blake3::hash(content).to_hex().to_string()
}

fn modified_ns(metadata: &Metadata) -> Option<u64> {
    let since = metadata.modified().ok()?.duration_since(UNIX_EPOCH).ok()?;
    u64::try_from(since.as_nanos()).ok()
}

/// Whether a change that is made now has another time.
fn is_past(modified_ns: u64) -> bool {
    let tick = if modified_ns.is_multiple_of(1_000_000_000) { COARSE_TICK } else { TICK };
    let modified = UNIX_EPOCH + Duration::from_nanos(modified_ns);
    // A time to come tells nothing of the past.
    SystemTime::now().duration_since(modified).is_ok_and(|age| age > tick)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{self, File};

    fn set_age(path: &Path, age: Duration) {
        File::options()
            .write(true)
            .open(path)
            .unwrap()
            .set_modified(SystemTime::now() - age)
            .unwrap();
    }

    #[test]
    fn a_file_is_read_again_when_its_size_or_time_differs_or_is_too_young_to_tell() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        fs::write(&path, "one").unwrap();
        assert_eq!(Stamp::read(&path).unwrap().modified_ns, None);
        set_age(&path, Duration::from_secs(10));
        let stamp = Stamp::read(&path).unwrap();
        assert!(stamp.is_current(&path));
        let time = fs::metadata(&path).unwrap().modified().unwrap();
        fs::write(&path, "two").unwrap();
        File::options().write(true).open(&path).unwrap().set_modified(time).unwrap();
        assert!(stamp.is_current(&path) && !stamp.is_content_of(&path));
        assert_eq!(Stamp::renew(&path, Some(&stamp), false).unwrap(), stamp);
        assert_eq!(Stamp::renew(&path, Some(&stamp), true).unwrap().blake3, hash(b"two"));
        set_age(&path, Duration::from_secs(20));
        assert!(!stamp.is_current(&path));
        fs::remove_file(&path).unwrap();
        assert!(!stamp.is_current(&path) && Stamp::read(&path).is_err());
    }
}
