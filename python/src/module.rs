//! Entry point of the Python module, written by hand instead of with pyo3's macros.

use std::ffi::OsString;
use std::path::PathBuf;
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

/// Adds the functions to the module.
fn fill(module: Bound<'_, PyModule>) -> PyResult<Bound<'_, PyModule>> {
    let py = module.py();
    trilink_tables::hush_damaged_tables();
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("main", PyCFunction::new_closure(py, Some(c"main"), None, main)?)?;
    module.add("call", PyCFunction::new_closure(py, Some(c"call"), None, call)?)?;
    module.add("read", PyCFunction::new_closure(py, Some(c"read"), None, read)?)?;
    module.add("simulate", PyCFunction::new_closure(py, Some(c"simulate"), None, simulate)?)?;
    module.add("objective", PyCFunction::new_closure(py, Some(c"objective"), None, objective)?)?;
    module.add("table", PyCFunction::new_closure(py, Some(c"table"), None, table)?)?;
    module.add("markers", PyCFunction::new_closure(py, Some(c"markers"), None, markers)?)?;
    Ok(module)
}

type Keywords<'k, 'py> = Option<&'k Bound<'py, PyDict>>;

fn main(arguments: &Bound<'_, PyTuple>, _: Keywords<'_, '_>) -> PyResult<u8> {
    let (line,) = arguments.extract()?;
    Ok(crate::main(arguments.py(), line))
}

fn call(arguments: &Bound<'_, PyTuple>, _: Keywords<'_, '_>) -> PyResult<Py<PyTuple>> {
    let (line, progress): (Vec<OsString>, String) = arguments.extract()?;
    Ok(crate::call::call(arguments.py(), line, &progress)?.unbind())
}

fn read(arguments: &Bound<'_, PyTuple>, _: Keywords<'_, '_>) -> PyResult<Py<PyTuple>> {
    let (table, folder, config, columns, condition) = arguments.extract()?;
    Ok(crate::read(arguments.py(), (table, folder, config), columns, condition)?.unbind())
}

fn simulate(arguments: &Bound<'_, PyTuple>, _: Keywords<'_, '_>) -> PyResult<Py<PyTuple>> {
    let (request,): (String,) = arguments.extract()?;
    Ok(crate::simulate::simulate(arguments.py(), &request)?.unbind())
}

fn objective(arguments: &Bound<'_, PyTuple>, _: Keywords<'_, '_>) -> PyResult<Py<PyTuple>> {
    let (config, campaign, model): (Option<PathBuf>, String, String) = arguments.extract()?;
    Ok(crate::objective::objective(arguments.py(), config, &campaign, &model)?.unbind())
}

fn markers(arguments: &Bound<'_, PyTuple>, _: Keywords<'_, '_>) -> PyResult<Py<PyTuple>> {
    let (path, unit): (PathBuf, String) = arguments.extract()?;
    Ok(crate::mocap::read(arguments.py(), path, &unit)?.unbind())
}

fn table(arguments: &Bound<'_, PyTuple>, _: Keywords<'_, '_>) -> PyResult<Py<PyCFunction>> {
    let (columns,) = arguments.extract()?;
    Ok(crate::table::from_columns(arguments.py(), columns)?.unbind())
}
