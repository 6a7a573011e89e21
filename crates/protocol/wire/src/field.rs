//! Checks of single fields: numbers, texts, digests, choices, parts and lists, each refused by name and value.

use ds_space::Digest;

use crate::error::FieldError;

/// Takes a finite number.
pub(crate) fn number(field: &str, value: Option<f64>) -> Result<f64, FieldError> {
    match value {
        Some(value) if value.is_finite() => Ok(value),
        Some(value) => Err(FieldError::new(field, format!("is {value}"))),
        None => Err(FieldError::new(field, "is missing")),
    }
}

/// Takes a finite number that is not negative.
pub(crate) fn extent(field: &str, value: Option<f64>) -> Result<f64, FieldError> {
    match number(field, value)? {
        value if value < 0.0 => Err(FieldError::new(field, format!("is {value}, below 0"))),
        value => Ok(value),
    }
}

/// Takes a finite number above 0.
pub(crate) fn positive(field: &str, value: Option<f64>) -> Result<f64, FieldError> {
    match number(field, value)? {
        value if value <= 0.0 => Err(FieldError::new(field, format!("is {value}, not above 0"))),
        value => Ok(value),
    }
}

/// Takes a finite number that may be absent.
pub(crate) fn perhaps(field: &str, value: Option<f64>) -> Result<Option<f64>, FieldError> {
    value.map(|value| number(field, Some(value))).transpose()
}

/// Takes a whole number within bounds.
pub(crate) fn whole<N: PartialOrd + std::fmt::Display>(
    field: &str,
    value: N,
    least: N,
    most: N,
) -> Result<N, FieldError> {
    if value < least || value > most {
        return Err(FieldError::new(field, format!("is {value}, must be {least} to {most}")));
    }
    Ok(value)
}

/// Takes a text of at most so many bytes.
pub(crate) fn text(field: &str, value: String, most: usize) -> Result<String, FieldError> {
    if value.len() > most {
        return Err(FieldError::new(field, format!("has {} bytes, the limit is {most}", value.len())));
    }
    Ok(value)
}

/// Takes a choice by its name.
pub(crate) fn named<T>(field: &str, name: &str, from_name: fn(&str) -> Option<T>) -> Result<T, FieldError> {
    from_name(name).ok_or_else(|| FieldError::new(field, format!("is {name:?}, no known name")))
}

/// Takes a digest.
pub(crate) fn digest(field: &str, value: &[u8]) -> Result<Digest, FieldError> {
    let bytes = <[u8; 32]>::try_from(value)
        .map_err(|_| FieldError::new(field, format!("has {} bytes, a digest has 32", value.len())))?;
    Ok(Digest(bytes))
}

/// Takes an id, a trajectory, an image: anything whose own check says what is wrong.
pub(crate) fn checked<T, E: std::fmt::Display>(field: &str, value: Result<T, E>) -> Result<T, FieldError> {
    value.map_err(|error| FieldError::new(field, format!("is refused: {error}")))
}

/// Takes one of the known values of an enum.
pub(crate) fn choice<W, T>(field: &str, value: i32) -> Result<T, FieldError>
where
    W: TryFrom<i32>,
    T: TryFrom<W, Error = FieldError>,
{
    let known = W::try_from(value).map_err(|_| FieldError::new(field, format!("is {value}, no known value")))?;
    T::try_from(known).map_err(|error| error.below(field))
}

/// Takes a required part.
pub(crate) fn part<M, T>(field: &str, value: Option<M>) -> Result<T, FieldError>
where
    T: TryFrom<M, Error = FieldError>,
{
    let message = value.ok_or_else(|| FieldError::new(field, "is missing"))?;
    T::try_from(message).map_err(|error| error.below(field))
}

/// Takes a list of at most so many elements.
pub(crate) fn list<M, T>(field: &str, values: Vec<M>, most: usize) -> Result<Vec<T>, FieldError>
where
    T: TryFrom<M, Error = FieldError>,
{
    if values.len() > most {
        return Err(FieldError::new(field, format!("has {} elements, the limit is {most}", values.len())));
    }
    let convert = |(index, value)| T::try_from(value).map_err(|error: FieldError| error.within(field, index));
    values.into_iter().enumerate().map(convert).collect()
}

/// Takes a list of enum values of at most so many elements.
pub(crate) fn choices<W, T>(field: &str, values: &[i32], most: usize) -> Result<Vec<T>, FieldError>
where
    W: TryFrom<i32>,
    T: TryFrom<W, Error = FieldError>,
{
    if values.len() > most {
        return Err(FieldError::new(field, format!("has {} elements, the limit is {most}", values.len())));
    }
    let convert =
        |(index, value): (usize, &i32)| choice::<W, T>("", *value).map_err(|error| error.within(field, index));
    values.iter().enumerate().map(convert).collect()
}

/// Declares the two directions between a value's enum and the wire's, variant by variant.
macro_rules! enumeration {
    ($wire:ty, $value:ty, { $($variant:ident = $wire_variant:ident),+ $(,)? }) => {
        impl From<$value> for $wire {
            fn from(value: $value) -> Self {
                match value {
                    $(<$value>::$variant => Self::$wire_variant,)+
                }
            }
        }

        impl TryFrom<$wire> for $value {
            type Error = crate::error::FieldError;
            fn try_from(value: $wire) -> Result<Self, Self::Error> {
                match value {
                    $(<$wire>::$wire_variant => Ok(Self::$variant),)+
                    <$wire>::Unspecified => Err(crate::error::FieldError::new("", "is unspecified")),
                }
            }
        }
    };
}
pub(crate) use enumeration;
