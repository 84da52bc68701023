"""The source that carries a scalar kernel into CVODES: C callbacks and the loop over samples, all compiled.

It calls the functions of a kernel of :mod:`~bwbn_bayes.engines.scalar_source`. Pointers are integers; the functions of
the C library are external symbols, found once the library is loaded.

References
----------
.. [1] A. C. Hindmarsh et al., "SUNDIALS: Suite of Nonlinear and Differential/Algebraic Equation Solvers", ACM Trans.
   Math. Softw. 31(3), 2005, doi:10.1145/1089014.1089020.
.. [2] R. Serban and A. C. Hindmarsh, "CVODES: the Sensitivity-Enabled ODE Solver in SUNDIALS", 2005,
   doi:10.1115/DETC2005-85597.
"""

from __future__ import annotations

from bwbn_bayes.elements.law import StoreyLaw
from bwbn_bayes.engines.codegen import LawPrograms
from bwbn_bayes.engines.scalar_source import FLAGS, HEAD, layout

_CALLBACKS = '''\
from numba import carray, types
from numba.extending import intrinsic

from bwbn_bayes.engines.kernel_cache import cfunc

_C = {{"i": types.int32, "l": types.int64, "p": types.intp, "d": types.float64, "v": types.void}}


def _external(name, signature):
    result, *arguments = signature
    return types.ExternalFunction(name, _C[result](*(_C[argument] for argument in arguments)))


SUNContext_Create = _external("SUNContext_Create", "iip")
SUNContext_ClearErrHandlers = _external("SUNContext_ClearErrHandlers", "ip")
SUNContext_Free = _external("SUNContext_Free", "ip")
N_VMake_Serial = _external("N_VMake_Serial", "plpp")
N_VGetArrayPointer = _external("N_VGetArrayPointer", "pp")
N_VDestroy = _external("N_VDestroy", "vp")
SUNDenseMatrix = _external("SUNDenseMatrix", "pllp")
SUNDenseMatrix_Data = _external("SUNDenseMatrix_Data", "pp")
SUNMatDestroy = _external("SUNMatDestroy", "vp")
SUNLinSol_Dense = _external("SUNLinSol_Dense", "pppp")
SUNLinSolFree = _external("SUNLinSolFree", "ip")
SUNNonlinSol_FixedPoint = _external("SUNNonlinSol_FixedPoint", "ppip")
SUNNonlinSol_FixedPointSens = _external("SUNNonlinSol_FixedPointSens", "pipip")
SUNNonlinSolFree = _external("SUNNonlinSolFree", "ip")
CVodeCreate = _external("CVodeCreate", "pip")
CVodeInit = _external("CVodeInit", "ippdp")
CVodeReInit = _external("CVodeReInit", "ipdp")
CVodeSStolerances = _external("CVodeSStolerances", "ipdd")
CVodeSetUserData = _external("CVodeSetUserData", "ipp")
CVodeSetMaxNumSteps = _external("CVodeSetMaxNumSteps", "ipl")
CVodeSetMaxHnilWarns = _external("CVodeSetMaxHnilWarns", "ipi")
CVodeSetStopTime = _external("CVodeSetStopTime", "ipd")
CVodeSetNonlinearSolver = _external("CVodeSetNonlinearSolver", "ipp")
CVodeSetLinearSolver = _external("CVodeSetLinearSolver", "ippp")
CVodeSetJacFn = _external("CVodeSetJacFn", "ipp")
CVodeSensInit = _external("CVodeSensInit", "ipiipp")
CVodeSensReInit = _external("CVodeSensReInit", "ipip")
CVodeSetSensParams = _external("CVodeSetSensParams", "ipppp")
CVodeSensEEtolerances = _external("CVodeSensEEtolerances", "ip")
CVodeSetSensErrCon = _external("CVodeSetSensErrCon", "ipi")
CVodeSetNonlinearSolverSensStg = _external("CVodeSetNonlinearSolverSensStg", "ipp")
CVodeGetNumSteps = _external("CVodeGetNumSteps", "ipp")
CVodeGetSens = _external("CVodeGetSens", "ippp")
CVode = _external("CVode", "ipdppi")
CVodeFree = _external("CVodeFree", "vp")


@intrinsic
def _floats_at(typing_context, address):
    """A pointer to doubles from an address."""
    def generate(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], context.get_value_type(types.CPointer(types.float64)))
    return types.CPointer(types.float64)(types.intp), generate


@intrinsic
def _addresses_at(typing_context, address):
    """A pointer to addresses from an address."""
    def generate(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], context.get_value_type(types.CPointer(types.intp)))
    return types.CPointer(types.intp)(types.intp), generate


@njit({flags})
def _n_numbers(data):
    """Length of a draw's flat array, from its head."""
    return {head} + int(data[0]) * ({block} + int(data[3])) + int(data[2]) * int(data[4])


def _rates_callback(t, y, dy, data_address):
    data = carray(_floats_at(data_address), ({head} + 1,))
    n = int(data[0]) * {n_rows} + {n_base_rows}
    data = carray(_floats_at(data_address), (_n_numbers(data),))
    return rhs(t, carray(_floats_at(N_VGetArrayPointer(y)), (n,)), carray(_floats_at(N_VGetArrayPointer(dy)), (n,)),
               data)


def _jacobian_callback(t, y, dy, matrix, data_address, room_1, room_2, room_3):
    data = carray(_floats_at(data_address), ({head} + 1,))
    n = int(data[0]) * {n_rows} + {n_base_rows}
    data = carray(_floats_at(data_address), (_n_numbers(data),))
    jacobian(carray(_floats_at(N_VGetArrayPointer(y)), (n,)), carray(_floats_at(SUNDenseMatrix_Data(matrix)), (n, n)),
             data)
    return 0


def _tangents_callback(n_directions, t, y, dy, tangents, rates_of_tangents, data_address, room_1, room_2):
    data = carray(_floats_at(data_address), ({head} + 1,))
    n = int(data[0]) * {n_rows} + {n_base_rows}
    data = carray(_floats_at(data_address), (_n_numbers(data),))
    slopes(carray(_floats_at(N_VGetArrayPointer(y)), (n,)), ground_at(t, data), data)
    inward = carray(_addresses_at(tangents), (n_directions,))
    outward = carray(_addresses_at(rates_of_tangents), (n_directions,))
    for k in range(n_directions):
        direction(k, carray(_floats_at(N_VGetArrayPointer(inward[k])), (n,)),
                  carray(_floats_at(N_VGetArrayPointer(outward[k])), (n,)), data)
    return 0


_P = types.intp
_FAST = {{"contract", "reassoc", "arcp", "nsz"}}
_OPTIONS = {{"nopython": True, "error_model": "numpy", "fastmath": _FAST}}
rates_callback = cfunc(types.int32(types.float64, _P, _P, _P), **_OPTIONS)(_rates_callback)
jacobian_callback = cfunc(types.int32(types.float64, _P, _P, _P, _P, _P, _P, _P), **_OPTIONS)(_jacobian_callback)
tangents_callback = cfunc(types.int32(types.int32, types.float64, _P, _P, _P, _P, _P, _P, _P), **_OPTIONS)(
    _tangents_callback
)
'''

_SOLVE = '''

@njit({flags})
def advance(memory, vector, y, tangents, pointers, until, max_steps, used, box, counter):
    """Carry state and tangents to ``until``; returns a flag of CVODES, -1 where the steps are used up."""
    flag = CVode(memory, until, vector, box.ctypes.data, 1)
    if flag >= 0 and tangents.shape[0] > 0:
        CVodeGetSens(memory, box.ctypes.data, pointers.ctypes.data)
    CVodeGetNumSteps(memory, counter.ctypes.data)
    return -1 if flag >= 0 and used + counter[0] > max_steps else flag


@njit({flags})
def walk(memory, vector, pointers, y, tangents, max_steps, starts, row, coefficient, ground_part, data, out):
    n_times, dt = int(data[2]), data[1]
    n_directions = tangents.shape[0]
    box = np.zeros(1)
    counter = np.zeros(1, dtype=np.int64)
    rate = np.zeros_like(y)
    before = np.zeros_like(y)
    after = np.zeros_like(y)
    tolerance = 1e-9 * dt
    used = 0
    event = next_event(0.0, tolerance, data)
    if event < np.inf:
        CVodeSetStopTime(memory, event)
    for j in range(n_times):
        now, end = j * dt, (j + 1) * dt
        slope = y[1]
        drive(j, y, data)
        if {driven} and j > 0 and y[1] != slope:
            CVodeReInit(memory, now, vector)
            if n_directions > 0:
                CVodeSensReInit(memory, 2, pointers.ctypes.data)
            if event < np.inf:
                CVodeSetStopTime(memory, event)
        rates(y, ground_at(now, data), rate, data)
        observe(j, y, tangents, starts, row, coefficient, ground_part, data, out[j])
        if j + 1 == n_times:
            break
        while now < end:
            until = event if event < end - tolerance else end
            if {driven}:
                CVodeSetStopTime(memory, until)
            flag = advance(memory, vector, y, tangents, pointers, until, max_steps, used, box, counter)
            if flag < 0:
                return flag
            now = until
            if event <= until + tolerance:
                strike(until + tolerance, ground_at(now, data), y, tangents, before, after, data)
                used += counter[0]
                CVodeReInit(memory, now, vector)
                if n_directions > 0:
                    CVodeSensReInit(memory, 2, pointers.ctypes.data)
                event = next_event(now, tolerance, data)
                if event < np.inf:
                    CVodeSetStopTime(memory, event)
    return 0


@njit({flags})
def run_cvodes(stiff, rtol, atol, max_steps, scales, rates_address, jacobian_address, tangents_address,
               starts, row, coefficient, ground_part, data, state, out):
    """Solve one draw; every object of the library is made and freed here. Returns a flag of CVODES."""
    n_directions = int(data[3])
    n = int(data[0]) * {n_rows} + {n_base_rows}
    y = state[0]
    tangents = state[1:]
    pointers = np.zeros(max(n_directions, 1), dtype=np.int64)
    box = np.zeros(1, dtype=np.int64)
    SUNContext_Create(0, box.ctypes.data)
    context = box[0]
    SUNContext_ClearErrHandlers(context)
    vector = N_VMake_Serial(n, y.ctypes.data, context)
    prepare(data)
    drive(0, y, data)
    strike(1e-9 * data[1], 0.0, y, tangents[:0], y, y, data)
    memory = CVodeCreate(2 if stiff else 1, context)
    CVodeInit(memory, rates_address, 0.0, vector)
    CVodeSStolerances(memory, rtol, atol)
    CVodeSetUserData(memory, data.ctypes.data)
    CVodeSetMaxNumSteps(memory, max_steps)
    CVodeSetMaxHnilWarns(memory, -1)
    matrix = linear = nonlinear = nonlinear_tangents = 0
    if stiff:
        matrix = SUNDenseMatrix(n, n, context)
        linear = SUNLinSol_Dense(vector, matrix, context)
        CVodeSetLinearSolver(memory, linear, matrix)
        CVodeSetJacFn(memory, jacobian_address)
    else:
        nonlinear = SUNNonlinSol_FixedPoint(vector, 0, context)
        CVodeSetNonlinearSolver(memory, nonlinear)
    if n_directions > 0:
        for k in range(n_directions):
            pointers[k] = N_VMake_Serial(n, tangents.ctypes.data + 8 * n * k, context)
        CVodeSensInit(memory, n_directions, 2, tangents_address, pointers.ctypes.data)
        CVodeSetSensParams(memory, 0, scales.ctypes.data, 0)
        CVodeSensEEtolerances(memory)
        CVodeSetSensErrCon(memory, 1)
        if not stiff:
            nonlinear_tangents = SUNNonlinSol_FixedPointSens(n_directions, vector, 0, context)
            CVodeSetNonlinearSolverSensStg(memory, nonlinear_tangents)
    flag = walk(memory, vector, pointers, y, tangents, max_steps, starts, row, coefficient, ground_part, data, out)
    box[0] = memory
    CVodeFree(box.ctypes.data)
    if stiff:
        SUNLinSolFree(linear)
        SUNMatDestroy(matrix)
    else:
        SUNNonlinSolFree(nonlinear)
        if n_directions > 0:
            SUNNonlinSolFree(nonlinear_tangents)
    for k in range(n_directions):
        N_VDestroy(pointers[k])
    N_VDestroy(vector)
    box[0] = context
    SUNContext_Free(box.ctypes.data)
    return flag
'''


def cvodes_source(law: StoreyLaw, programs: LawPrograms, *, driven: bool) -> str:
    """Source of what the CVODES kernel of one storey law has above the scalar one: callbacks, the loop over samples."""
    place = layout(law, programs)
    fields = {
        "flags": FLAGS,
        "head": HEAD,
        "block": place.block,
        "n_rows": place.n_rows,
        "n_base_rows": place.n_base_rows,
        "driven": str(driven),
    }
    return "".join(part.format(**fields) for part in (_CALLBACKS, _SOLVE))
