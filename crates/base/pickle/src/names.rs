//! The two allow-lists: names that data of Python are made of, and names that PyTorch's tensors are made of.

/// What a pickle may hold; anything that is not on its list is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AllowList {
    /// Containers, paths and NumPy's arrays.
    Data,
    /// Ordered dictionaries of PyTorch's tensors, whose values lie in storages outside the pickle.
    Tensors,
}

/// What may be called.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Callable {
    /// Makes an empty array for a state.
    Reconstruct,
    /// Makes an array of a buffer.
    FromBuffer,
    /// Makes a number of an array's kind.
    Scalar,
    /// The array type.
    NdArray,
    /// Makes a kind of array items.
    Dtype,
    /// Encodes a text as bytes.
    Encode,
    /// Makes a dict.
    Dict,
    /// Makes a list.
    List,
    /// Makes a tuple.
    Tuple,
    /// Makes a set.
    Set,
    /// Makes bytes.
    Bytes,
    /// Makes a path.
    Path,
    /// A type that is only named, such as the factory of a default dict.
    Inert,
    /// Makes a tensor's shape of a tuple.
    Size,
    /// Makes a tensor of a part of a storage.
    Tensor,
    /// Makes a parameter of a tensor.
    Parameter,
    /// A type of storage, such as `BFloat16Storage`.
    Storage(&'static str),
}

const STORAGES: [&str; 10] = [
    "FloatStorage",
    "HalfStorage",
    "BFloat16Storage",
    "DoubleStorage",
    "LongStorage",
    "IntStorage",
    "ShortStorage",
    "CharStorage",
    "ByteStorage",
    "BoolStorage",
];

impl AllowList {
    /// Returns the most bytes that the values of one pickle may take, roughly.
    #[must_use]
    pub fn memory_bytes(self) -> usize {
        match self {
            Self::Data => 512 << 20,
            Self::Tensors => 16 << 20,
        }
    }

    /// Returns what a name stands for, if it is on the list.
    pub(crate) fn callable(self, module: &str, name: &str) -> Option<Callable> {
        match self {
            Self::Data => data(module, name),
            Self::Tensors => tensors(module, name),
        }
    }
}

fn data(module: &str, name: &str) -> Option<Callable> {
    let callable = match (module, name) {
        ("numpy.core.multiarray" | "numpy._core.multiarray", "_reconstruct") => Callable::Reconstruct,
        ("numpy.core.multiarray" | "numpy._core.multiarray", "scalar") => Callable::Scalar,
        ("numpy.core.numeric" | "numpy._core.numeric", "_frombuffer") => Callable::FromBuffer,
        ("numpy", "ndarray") => Callable::NdArray,
        ("numpy", "dtype") => Callable::Dtype,
        ("_codecs", "encode") => Callable::Encode,
        ("collections", "OrderedDict" | "defaultdict") => Callable::Dict,
        ("builtins" | "__builtin__", "dict") => Callable::Dict,
        ("builtins" | "__builtin__", "list") => Callable::List,
        ("builtins" | "__builtin__", "tuple") => Callable::Tuple,
        ("builtins" | "__builtin__", "set" | "frozenset") => Callable::Set,
        ("builtins" | "__builtin__", "bytes" | "bytearray") => Callable::Bytes,
        ("builtins" | "__builtin__", "int" | "float" | "bool" | "str") => Callable::Inert,
        ("pathlib" | "pathlib._local", "PosixPath" | "PurePosixPath" | "WindowsPath" | "PureWindowsPath") => {
            Callable::Path
        }
        ("metadrive.scenario.scenario_description" | "metadrive.scenario", "ScenarioDescription") => Callable::Dict,
        _ => return None,
    };
    Some(callable)
}

fn tensors(module: &str, name: &str) -> Option<Callable> {
    match (module, name) {
        ("collections", "OrderedDict") => Some(Callable::Dict),
        ("torch", "Size") => Some(Callable::Size),
        ("torch._utils", "_rebuild_tensor_v2" | "_rebuild_tensor") => Some(Callable::Tensor),
        ("torch._utils", "_rebuild_parameter") => Some(Callable::Parameter),
        ("torch", _) => STORAGES.into_iter().find(|storage| *storage == name).map(Callable::Storage),
        _ => None,
    }
}
