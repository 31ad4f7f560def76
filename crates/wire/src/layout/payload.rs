//! How a payload describes itself: from one definition follow the structure, its checks, its default, and a table of its
//! values that the JSON form, the documents and the clients in other languages are made from.

use super::codes::Codes;

/// Common interface of the payloads. Implemented by the payloads of this crate only.
pub trait Payload: sealed::Plain + Copy + Default + std::fmt::Debug + PartialEq + 'static {
    /// Name, size and values.
    const LAYOUT: &'static Layout;

    /// The payload's bytes as they lie in shared memory, with what they mean.
    fn view(&self) -> View<'_> {
        // SAFETY: `Plain` guarantees a structure without padding, so all its bytes are initialised; they live as long as
        // `self` is borrowed.
        let bytes = unsafe { std::slice::from_raw_parts(std::ptr::from_ref(self).cast(), size_of::<Self>()) };
        View { layout: Self::LAYOUT, bytes }
    }

    /// The payload's bytes, to be written.
    fn bytes_mut(&mut self) -> &mut [u8] {
        // SAFETY: as in `view`; `Plain` guarantees that every bit pattern is a valid value.
        unsafe { std::slice::from_raw_parts_mut(std::ptr::from_mut(self).cast(), size_of::<Self>()) }
    }
}

pub(super) mod sealed {
    /// Data that may lie in shared memory.
    ///
    /// # Safety
    /// The type is `#[repr(C)]`, made of integers, floats and arrays of them only, and has no padding.
    pub unsafe trait Plain: iceoryx2::prelude::ZeroCopySend {}
}

/// Name, size and values of a payload.
#[derive(Debug, PartialEq)]
pub struct Layout {
    /// Name in Rust and Python, such as `State`.
    pub name: &'static str,
    /// Name in shared memory, with the layout version, such as `softtwin.State.v1`.
    pub type_name: &'static str,
    /// Name of its JSON schema, such as `softtwin.State`.
    pub schema: &'static str,
    /// Meaning.
    pub meaning: &'static str,
    /// Bytes; the alignment is 8.
    pub size: usize,
    /// Its values, in order, without gaps.
    pub fields: &'static [Field],
    /// The properties of its JSON form, in order: key and value.
    pub json: &'static [(&'static str, Field)],
}

/// One value of a payload, or a list of values of one kind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Field {
    /// Name.
    pub name: &'static str,
    /// Bytes from the payload's begin.
    pub offset: usize,
    /// Type of a value.
    pub scalar: Scalar,
    /// How many values: 1, or the length of the list.
    pub count: usize,
    /// Unit; empty: none.
    pub unit: &'static str,
    /// Meaning, and the value if it is unknown.
    pub meaning: &'static str,
    /// How it is shown.
    pub show: Show,
}

/// Type of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)] // the types' own names
pub enum Scalar {
    U8,
    U32,
    U64,
    F32,
    F64,
}

/// How a value is shown to people and in JSON.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Show {
    /// As a number, or a list of numbers.
    Number,
    /// List of numbers, whose length is in the field of this name.
    Counted(&'static str),
    /// As a list of the numbers before the first 0.
    UntilZero,
    /// As hexadecimal digits: hashes, runs.
    Hex,
    /// Zero-padded name.
    Name,
    /// As the names of the bits that are set.
    Flags(Codes),
    /// As the name of the number.
    Code(Codes),
    /// As the names of the fields, as many as `field_count` says.
    FieldNames,
    /// List of the codes' names, whose length is in the field of this name.
    Codes(Codes, &'static str),
    /// List of zero-padded names of 32 bytes, whose length is in the field of this name.
    Names(&'static str),
    /// As one number for each name.
    PerCode(Codes),
}

/// A number of a payload.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Number {
    /// A counter, a code, a stamp.
    Whole(u64),
    /// Single precision.
    Single(f32),
    /// Double precision.
    Double(f64),
}

/// A payload's bytes with what they mean.
#[derive(Debug, Clone, Copy)]
pub struct View<'a> {
    /// Layout of the bytes.
    pub layout: &'static Layout,
    /// The payload as it lies in shared memory.
    pub bytes: &'a [u8],
}

impl<'a> View<'a> {
    /// The bytes of a field; empty when the field is of another payload.
    pub fn bytes(&self, field: &Field) -> &'a [u8] {
        self.bytes.get(field.range()).unwrap_or_default()
    }

    /// The numbers of a field.
    pub fn numbers(&self, field: &Field) -> impl Iterator<Item = Number> + use<'a> {
        let scalar = field.scalar;
        self.bytes(field).chunks_exact(scalar.size()).filter_map(move |bytes| {
            Some(match scalar {
                Scalar::U8 => Number::Whole((*bytes.first()?).into()),
                Scalar::U32 => Number::Whole(u32::from_le_bytes(bytes.try_into().ok()?).into()),
                Scalar::U64 => Number::Whole(u64::from_le_bytes(bytes.try_into().ok()?)),
                Scalar::F32 => Number::Single(f32::from_le_bytes(bytes.try_into().ok()?)),
                Scalar::F64 => Number::Double(f64::from_le_bytes(bytes.try_into().ok()?)),
            })
        })
    }

    /// Integers of a field.
    pub fn wholes(&self, field: &Field) -> impl Iterator<Item = u64> + use<'a> {
        self.numbers(field).filter_map(|number| match number {
            Number::Whole(whole) => Some(whole),
            _ => None,
        })
    }

    /// Integer of that name; `None` if this payload does not have it.
    pub fn whole(&self, name: &str) -> Option<u64> {
        let field = self.layout.fields.iter().find(|field| field.name == name)?;
        self.wholes(field).next()
    }
}

impl Field {
    /// Where it lies among the payload's bytes.
    pub fn range(&self) -> std::ops::Range<usize> {
        self.offset..self.offset + self.scalar.size() * self.count
    }
}

impl Scalar {
    /// Bytes of a value.
    pub const fn size(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U32 | Self::F32 => 4,
            Self::U64 | Self::F64 => 8,
        }
    }

    /// Name of the type in Rust, such as `u32`.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::U8 => "u8",
            Self::U32 => "u32",
            Self::U64 => "u64",
            Self::F32 => "f32",
            Self::F64 => "f64",
        }
    }
}

/// Value types of a payload's fields.
pub(super) trait Value {
    const SCALAR: Scalar;
    const COUNT: usize;
}

macro_rules! values {
    ($($type:ty: $scalar:ident),+) => {$(
        impl Value for $type {
            const SCALAR: Scalar = Scalar::$scalar;
            const COUNT: usize = 1;
        }
        impl<const N: usize> Value for [$type; N] {
            const SCALAR: Scalar = Scalar::$scalar;
            const COUNT: usize = N;
        }
    )+};
}
values!(u8: U8, u32: U32, u64: U64, f32: F32, f64: F64);

/// The field of that name, shown in another way if asked. Evaluated at compile time: an unknown name does not compile.
#[allow(clippy::indexing_slicing)] // at compile time a wrong index is an error of the compiler
pub(super) const fn named(fields: &[Field], name: &str, show: Option<Show>) -> Field {
    let mut index = 0;
    while !is_same(fields[index].name.as_bytes(), name.as_bytes()) {
        index += 1;
    }
    let mut field = fields[index];
    if let Some(show) = show {
        field.show = show;
    }
    field
}

#[allow(clippy::indexing_slicing)] // both indices are checked in the condition
const fn is_same(left: &[u8], right: &[u8]) -> bool {
    let mut index = 0;
    while index < left.len() && index < right.len() && left[index] == right[index] {
        index += 1;
    }
    index == left.len() && index == right.len()
}

/// Defines a payload:
///
/// ```text
/// payload! {
///     /// Meaning.
///     Name "schema" {
///         /// What the value means.
///         name: type = value when it is not known, "unit", how it is shown;
///     }
///     json [key, key: field, key: field as how it is shown]
/// }
/// ```
///
/// A value is shown as a number by default. A definition with padding does not compile.
macro_rules! payload {
    (
        $(#[doc = $about:literal])+
        $name:ident $schema:literal {
            $(
                $(#[doc = $doc:literal])+
                $field:ident: $type:ty = $absent:expr, $unit:literal $(, $show:expr)?;
            )+
        }
        json [$($key:ident $(: $source:ident $(as $how:expr)?)?),+ $(,)?]
    ) => {
        $(#[doc = $about])+
        #[derive(Debug, Clone, Copy, PartialEq)]
        #[repr(C)]
        pub struct $name {
            $($(#[doc = $doc])+ pub $field: $type,)+
        }

        const _: () = {
            assert!(align_of::<$name>() == 8);
            assert!(0 $(+ size_of::<$type>())+ == size_of::<$name>(), "padding");
        };

        impl Default for $name {
            fn default() -> Self {
                Self { $($field: $absent),+ }
            }
        }

        impl $crate::layout::payload::Payload for $name {
            const LAYOUT: &'static $crate::layout::payload::Layout = {
                use $crate::layout::payload::{Field, Layout, Show, Value, named};
                const FIELDS: &[Field] = &[$(Field {
                    name: stringify!($field),
                    offset: std::mem::offset_of!($name, $field),
                    scalar: <$type as Value>::SCALAR,
                    count: <$type as Value>::COUNT,
                    unit: $unit,
                    meaning: concat!($($doc),+),
                    show: payload!(@last Show::Number $(, $show)?),
                }),+];
                &Layout {
                    name: stringify!($name),
                    type_name: concat!("softtwin.", stringify!($name), ".v", layout_version!()),
                    schema: $schema,
                    meaning: concat!($($about),+),
                    size: size_of::<$name>(),
                    fields: FIELDS,
                    json: &[$((
                        stringify!($key),
                        named(
                            FIELDS,
                            payload!(@last stringify!($key) $(, stringify!($source))?),
                            payload!(@last None $($(, Some($how))?)?),
                        ),
                    )),+],
                }
            };
        }

        // SAFETY: `#[repr(C)]` of numbers and arrays of numbers (`Value` is implemented for nothing else), whose sizes
        // add up to the structure's, as asserted above.
        unsafe impl $crate::layout::payload::sealed::Plain for $name {}

        // SAFETY: as above; the name changes with the layout version.
        unsafe impl iceoryx2::prelude::ZeroCopySend for $name {
            unsafe fn type_name() -> &'static str {
                <Self as $crate::layout::payload::Payload>::LAYOUT.type_name
            }
        }
    };
    (@last $default:expr) => { $default };
    (@last $default:expr, $given:expr) => { $given };
}
pub(super) use payload;
