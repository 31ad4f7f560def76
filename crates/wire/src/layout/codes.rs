//! Numbers that stand for something, each with its name.

/// A number with its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Code {
    /// The number in a payload; of a flag: its bit.
    pub number: u32,
    /// Name of the constant.
    pub constant: &'static str,
    /// Name for people, in JSON, as a metric's label.
    pub name: &'static str,
    /// Meaning.
    pub meaning: &'static str,
}

/// All numbers of one kind.
pub type Codes = &'static [Code];

/// The name of a number; `unknown` when it has none.
pub(super) fn name(codes: Codes, number: u32) -> &'static str {
    codes.iter().find(|code| code.number == number).map_or("unknown", |code| code.name)
}

/// A module of constants with their names: `ALL`, and `as_str` unless the module brings its own after the list.
macro_rules! codes {
    ($(#[doc = $about:literal])+ $module:ident: $type:ty { $($list:tt)+ }) => {
        $crate::layout::codes::codes! {
            $(#[doc = $about])+ $module: $type { $($list)+ }
            /// The name of a number; `unknown` when it has none.
            pub fn as_str(number: $type) -> &'static str {
                $crate::layout::codes::name(ALL, number.into())
            }
        }
    };
    (
        $(#[doc = $about:literal])+ $module:ident: $type:ty {
            $($(#[doc = $doc:literal])+ $constant:ident = $number:expr, $name:literal;)+
        }
        $($function:item)+
    ) => {
        $(#[doc = $about])+
        pub mod $module {
            $($(#[doc = $doc])+ pub const $constant: $type = $number;)+

            /// All of them with their names.
            pub const ALL: $crate::layout::Codes = &[$($crate::layout::Code {
                number: $number,
                constant: stringify!($constant),
                name: $name,
                meaning: concat!($($doc),+),
            }),+];

            $($function)+
        }
    };
}
pub(super) use codes;

/// An enumeration whose numbers are in payloads.
macro_rules! coded_enum {
    ($(#[doc = $about:literal])+ $enum:ident { $($(#[doc = $doc:literal])+ $variant:ident = $number:literal, $name:literal;)+ }) => {
        $(#[doc = $about])+
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        #[repr(u32)]
        pub enum $enum { $($(#[doc = $doc])+ $variant = $number,)+ }

        impl $enum {
            /// All in the order of their numbers.
            pub const ALL: &'static [$enum] = &[$($enum::$variant,)+];

            /// All codes with their numbers and names.
            pub const CODES: $crate::layout::Codes = &[$($crate::layout::Code {
                number: $number,
                constant: stringify!($variant),
                name: $name,
                meaning: concat!($($doc),+),
            }),+];

            /// The number in payloads.
            pub fn code(self) -> u32 {
                self as u32
            }

            /// The one of that number, if there is one.
            pub fn from_code(number: u32) -> Option<Self> {
                Self::ALL.iter().copied().find(|one| one.code() == number)
            }

            /// The text for people.
            pub fn as_str(self) -> &'static str {
                match self { $($enum::$variant => $name,)+ }
            }
        }
    };
}
pub(super) use coded_enum;
