//! Entry point of the Python module, written by hand instead of with pyo3's macros.

use std::ptr::{addr_of_mut, null, null_mut};

use pyo3::ffi;
use pyo3::prelude::*;
use pyo3::types::{PyCFunction, PyDict, PyModule, PyTuple};

/// Definition of the module, which Python uses until it exits.
static mut DEFINITION: ffi::PyModuleDef = ffi::PyModuleDef {
    m_base: ffi::PyModuleDef_HEAD_INIT,
    m_name: c"_trilink".as_ptr(),
    m_doc: null(),
    m_size: -1,
    m_methods: null_mut(),
    m_slots: null_mut(),
    m_traverse: None,
    m_clear: None,
    m_free: None,
};

/// Creates the module when Python imports it; Python requires this name.
///
/// # Safety
/// Must be called only once, by Python, while the interpreter lock is held.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn PyInit__trilink() -> *mut ffi::PyObject {
    Python::attach(|py| {
        // SAFETY: the interpreter is running and this thread holds its lock; the definition is static, and nothing else
        // accesses it.
        let made = unsafe {
            let module = ffi::PyModule_Create(addr_of_mut!(DEFINITION));
            Bound::from_owned_ptr_or_err(py, module)
        };
        match made.and_then(|module| fill(module.cast_into()?)) {
            Ok(module) => module.into_ptr(),
            Err(error) => {
                error.restore(py);
                null_mut()
            }
        }
    })
}

/// Adds the exception classes and functions to the module.
fn fill(module: Bound<'_, PyModule>) -> PyResult<Bound<'_, PyModule>> {
    let py = module.py();
    trilink_tables::hush_damaged_tables();
    crate::error::add_to(&module)?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("main", PyCFunction::new_closure(py, Some(c"main"), None, main)?)?;
    module.add("run", PyCFunction::new_closure(py, Some(c"run"), None, run)?)?;
    module.add("read", PyCFunction::new_closure(py, Some(c"read"), None, read)?)?;
    module.add("simulate", PyCFunction::new_closure(py, Some(c"simulate"), None, simulate)?)?;
    Ok(module)
}

type Keywords<'k, 'py> = Option<&'k Bound<'py, PyDict>>;

fn main(arguments: &Bound<'_, PyTuple>, _: Keywords<'_, '_>) -> PyResult<u8> {
    let (line,) = arguments.extract()?;
    Ok(crate::main(arguments.py(), line))
}

fn run(arguments: &Bound<'_, PyTuple>, _: Keywords<'_, '_>) -> PyResult<String> {
    let (request,): (String,) = arguments.extract()?;
    crate::run(arguments.py(), &request)
}

fn read(arguments: &Bound<'_, PyTuple>, _: Keywords<'_, '_>) -> PyResult<Py<PyTuple>> {
    let (request,): (String,) = arguments.extract()?;
    let (path, columns, rows, stream) = crate::read(arguments.py(), &request)?;
    Ok((path, columns, rows, stream.unbind()).into_pyobject(arguments.py())?.unbind())
}

fn simulate(arguments: &Bound<'_, PyTuple>, _: Keywords<'_, '_>) -> PyResult<Py<PyTuple>> {
    let (request,): (String,) = arguments.extract()?;
    let answer = crate::simulate::simulate(arguments.py(), &request)?;
    Ok(answer.into_pyobject(arguments.py())?.unbind())
}
