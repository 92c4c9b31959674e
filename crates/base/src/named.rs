//! Values that have names in files, in tables and on the command line.

/// Type whose values are identified by their names.
pub trait Named: Sized {
    /// Returns the first value of the type, which serves as a placeholder for an unknown value.
    fn first() -> Self;
    fn as_name(&self) -> &str;
    /// Returns the value with the given name; `None` if there is none.
    fn of_name(name: &str) -> Option<Self>;
}

impl Named for String {
    fn first() -> Self {
        Self::new()
    }

    fn as_name(&self) -> &str {
        self
    }

    fn of_name(name: &str) -> Option<Self> {
        Some(name.to_owned())
    }
}

/// Defines an enumeration whose values have names; serde reads and writes the values by these names.
#[macro_export]
macro_rules! named {
    ($(#[$meta:meta])* pub enum $type:ident {
        $($(#[$value_meta:meta])* $value:ident = $name:literal,)*
    }) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[derive(serde::Serialize, serde::Deserialize)]
        pub enum $type { $($(#[$value_meta])* #[serde(rename = $name)] $value,)* }

        impl $type {
            /// All values, in the order of their definition.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$value),*];

            /// Returns the name of the value in files and on the command line.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$value => $name,)* }
            }
        }

        impl $crate::Named for $type {
            fn first() -> Self {
                Self::ALL[0]
            }

            fn as_name(&self) -> &str {
                self.name()
            }

            fn of_name(name: &str) -> Option<Self> {
                Self::ALL.into_iter().find(|value| value.name() == name)
            }
        }

        impl std::fmt::Display for $type {
            fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.pad(self.name())
            }
        }
    };
}
