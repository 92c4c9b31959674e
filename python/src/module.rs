//! What Python finds when it imports the module. Without pyo3's macros its entry is written by hand.

use std::ptr::{addr_of_mut, null, null_mut};

use pyo3::ffi;
use pyo3::prelude::*;
use pyo3::types::{PyCFunction, PyDict, PyModule, PyTuple};

/// The module's definition, which Python keeps for as long as it runs.
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

/// Makes the module: the name is the one that Python looks for.
///
/// # Safety
/// Only Python calls it, with its lock held, once.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn PyInit__trilink() -> *mut ffi::PyObject {
    Python::attach(|py| {
        // SAFETY: the interpreter runs and this thread holds its lock; the definition lives as long as
        // the program, and nothing else touches it.
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

fn fill(module: Bound<'_, PyModule>) -> PyResult<Bound<'_, PyModule>> {
    let py = module.py();
    trilink_tables::hush_damaged_tables();
    crate::error::add_to(&module)?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    let main = |arguments: &Bound<'_, PyTuple>, _: Option<&Bound<'_, PyDict>>| {
        let (line,) = arguments.extract()?;
        PyResult::Ok(crate::main(arguments.py(), line))
    };
    module.add("main", PyCFunction::new_closure(py, Some(c"main"), None, main)?)?;
    let run = |arguments: &Bound<'_, PyTuple>, _: Option<&Bound<'_, PyDict>>| {
        let (request,): (String,) = arguments.extract()?;
        crate::run(arguments.py(), &request)
    };
    module.add("run", PyCFunction::new_closure(py, Some(c"run"), None, run)?)?;
    let read = |arguments: &Bound<'_, PyTuple>, _: Option<&Bound<'_, PyDict>>| {
        let (request,): (String,) = arguments.extract()?;
        let (path, columns, rows, stream) = crate::read(arguments.py(), &request)?;
        PyResult::Ok((path, columns, rows, stream.unbind()).into_pyobject(arguments.py())?.unbind())
    };
    module.add("read", PyCFunction::new_closure(py, Some(c"read"), None, read)?)?;
    let simulate = |arguments: &Bound<'_, PyTuple>, _: Option<&Bound<'_, PyDict>>| {
        let (request,): (String,) = arguments.extract()?;
        let answer = crate::simulate::simulate(arguments.py(), &request)?;
        PyResult::Ok(answer.into_pyobject(arguments.py())?.unbind())
    };
    module.add("simulate", PyCFunction::new_closure(py, Some(c"simulate"), None, simulate)?)?;
    Ok(module)
}
