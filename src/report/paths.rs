//! Paths of folders as the page gives them.

use std::path::{Component, Path, PathBuf};

/// `to` as seen from the folder `from`; as it is where one of them is absolute and the other
/// not, or where `from` climbs.
pub fn relative(from: &Path, to: &Path) -> String {
    let plain = |path: &Path| -> PathBuf {
        path.components().filter(|part| *part != Component::CurDir).collect()
    };
    let (from, to) = (plain(from), plain(to));
    let common = from.components().zip(to.components()).take_while(|(a, b)| a == b).count();
    let rest: Vec<_> = from.components().skip(common).collect();
    let climbs = rest.iter().any(|part| !matches!(part, Component::Normal(_)));
    let path = if climbs || from.is_absolute() != to.is_absolute() {
        to
    } else {
        rest.iter().map(|_| Component::ParentDir).chain(to.components().skip(common)).collect()
    };
    path.to_string_lossy().replace('\\', "/")
}

#[cfg(test)]
mod tests {
    use super::relative;
    use std::path::Path;

    #[test]
    fn paths_are_as_seen_from_the_page() {
        let from_to = |from, to| relative(Path::new(from), Path::new(to));
        assert_eq!(from_to("reports", "derived"), "../derived");
        assert_eq!(from_to("./a/reports", "a/raw/demo"), "../raw/demo");
        assert_eq!(from_to("/data/x/reports", "/data/x/derived"), "../derived");
        assert_eq!(from_to("../reports", "derived"), "derived");
    }
}
