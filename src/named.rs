//! Enumerations whose values have names, in files, in tables and on the command line.

/// An enumeration of [`named!`].
pub trait Named: Copy + 'static {
    /// Every value, in order.
    const VALUES: &'static [Self];

    /// Its name.
    fn as_str(self) -> &'static str;
}

/// Defines an enumeration with the names of its values; serde knows it by them.
macro_rules! named {
    ($(#[$meta:meta])* pub enum $type:ident {
        $($(#[$value_meta:meta])* $value:ident = $name:literal,)*
    }) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[derive(serde::Serialize, serde::Deserialize)]
        pub enum $type { $($(#[$value_meta])* #[serde(rename = $name)] $value,)* }

        impl $type {
            /// Every value.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$value),*];

            /// Its name in files and on the command line.
            pub fn name(self) -> &'static str {
                match self { $(Self::$value => $name,)* }
            }
        }

        impl $crate::named::Named for $type {
            const VALUES: &'static [Self] = &Self::ALL;
            fn as_str(self) -> &'static str {
                self.name()
            }
        }

        impl std::fmt::Display for $type {
            fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.pad(self.name())
            }
        }
    };
}

pub(crate) use named;
