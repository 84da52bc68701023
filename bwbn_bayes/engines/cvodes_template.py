"""The text that carries a scalar kernel into CVODES: what is called of the C library, callbacks, the loop over samples.

It stands behind that of :mod:`~bwbn_bayes.engines.scalar_source`, whose functions it calls. Pointers are integers; the
library's functions are found once it is loaded.

References
----------
.. [1] A. C. Hindmarsh et al., "SUNDIALS: Suite of Nonlinear and Differential/Algebraic Equation Solvers", ACM Trans.
   Math. Softw. 31(3), 2005, doi:10.1145/1089014.1089020.
.. [2] R. Serban and A. C. Hindmarsh, "CVODES: the Sensitivity-Enabled ODE Solver in SUNDIALS", 2005,
   doi:10.1115/DETC2005-85597.
"""

LIBRARY = """

def SUNContext_Create(communicator: int32, context: integers) -> int32: ...
def SUNContext_ClearErrHandlers(context: int) -> int32: ...
def SUNContext_Free(context: integers) -> int32: ...
def N_VMake_Serial(length: int, numbers: doubles, context: int) -> int: ...
def N_VGetArrayPointer(vector: int) -> int: ...
def N_VDestroy(vector: int): ...
def SUNDenseMatrix(n_rows: int, n_columns: int, context: int) -> int: ...
def SUNDenseMatrix_Data(matrix: int) -> int: ...
def SUNMatDestroy(matrix: int): ...
def SUNLinSol_Dense(vector: int, matrix: int, context: int) -> int: ...
def SUNLinSolFree(solver: int) -> int32: ...
def SUNNonlinSol_FixedPoint(vector: int, acceleration: int32, context: int) -> int: ...
def SUNNonlinSol_FixedPointSens(count: int32, vector: int, acceleration: int32, context: int) -> int: ...
def SUNNonlinSolFree(solver: int) -> int32: ...
def CVodeCreate(method: int32, context: int) -> int: ...
def CVodeInit(memory: int, rates: int, start: double, vector: int) -> int32: ...
def CVodeReInit(memory: int, start: double, vector: int) -> int32: ...
def CVodeSStolerances(memory: int, relative: double, absolute: double) -> int32: ...
def CVodeSetUserData(memory: int, data: doubles) -> int32: ...
def CVodeSetMaxNumSteps(memory: int, count: int) -> int32: ...
def CVodeSetMaxHnilWarns(memory: int, count: int32) -> int32: ...
def CVodeSetStopTime(memory: int, stop: double) -> int32: ...
def CVodeSetNonlinearSolver(memory: int, solver: int) -> int32: ...
def CVodeSetLinearSolver(memory: int, solver: int, matrix: int) -> int32: ...
def CVodeSetJacFn(memory: int, jacobian: int) -> int32: ...
def CVodeSensInit(memory: int, count: int32, method: int32, rates: int, vectors: integers) -> int32: ...
def CVodeSensReInit(memory: int, method: int32, vectors: integers) -> int32: ...
def CVodeSetSensParams(memory: int, parameters: int, scales: doubles, order: int) -> int32: ...
def CVodeSensEEtolerances(memory: int) -> int32: ...
def CVodeSetSensErrCon(memory: int, is_controlled: int32) -> int32: ...
def CVodeSetNonlinearSolverSensStg(memory: int, solver: int) -> int32: ...
def CVodeGetNumSteps(memory: int, count: integers) -> int32: ...
def CVodeGetSens(memory: int, time: doubles, vectors: integers) -> int32: ...
def CVode(memory: int, until: double, vector: int, time: doubles, task: int32) -> int32: ...
def CVodeFree(memory: integers): ...
"""

CALLBACKS = """

def n_states(data):
    return int(data[0]) * ROWS + BASE_ROWS


def n_numbers(data):
    # Length of a draw's flat array, from its head.
    return HEAD + int(data[0]) * (BLOCK + int(data[3])) + int(data[2]) * int(data[4])


def rates_callback(t: double, y: int, dy: int, address: int) -> int32:
    head = _doubles_at(address, HEAD)
    n = n_states(head)
    data = _doubles_at(address, n_numbers(head))
    return rhs(_doubles_at(N_VGetArrayPointer(y), n), _doubles_at(N_VGetArrayPointer(dy), n), data, t)


def jacobian_callback(t: double, y: int, dy: int, matrix: int, address: int, room_1: int, room_2: int,
                      room_3: int) -> int32:
    head = _doubles_at(address, HEAD)
    n = n_states(head)
    data = _doubles_at(address, n_numbers(head))
    jacobian(_doubles_at(N_VGetArrayPointer(y), n), _doubles_at(SUNDenseMatrix_Data(matrix), n, n),
             _doubles_at(N_VGetArrayPointer(room_1), n), data)
    return 0


def tangents_callback(n_directions: int32, t: double, y: int, dy: int, tangents: int, rates_of_tangents: int,
                      address: int, room_1: int, room_2: int) -> int32:
    head = _doubles_at(address, HEAD)
    n = n_states(head)
    data = _doubles_at(address, n_numbers(head))
    slopes(_doubles_at(N_VGetArrayPointer(y), n), ground_at(t, data), data)
    inward = _integers_at(tangents, n_directions)
    outward = _integers_at(rates_of_tangents, n_directions)
    for k in range(n_directions):
        direction(k, _doubles_at(N_VGetArrayPointer(inward[k]), n), _doubles_at(N_VGetArrayPointer(outward[k]), n),
                  data)
    return 0
"""

SOLVE = """

def carry(memory, vector, pointers, until, max_steps, used, counter, box):
    # Carry state and tangents to ``until``; returns a flag of CVODES, -1 where the steps are used up.
    flag = CVode(memory, until, vector, box, 1)
    if WITH_TANGENTS:
        if flag >= 0:
            CVodeGetSens(memory, box, pointers)
    CVodeGetNumSteps(memory, counter)
    return -1 if flag >= 0 and used + counter[0] > max_steps else flag


def start_anew(memory, vector, pointers, now, event):
    CVodeReInit(memory, now, vector)
    if WITH_TANGENTS:
        CVodeSensReInit(memory, 2, pointers)
    if event < np.inf:
        CVodeSetStopTime(memory, event)


def walk(memory, vector, pointers, y, tangents, max_steps, starts, row, coefficient, ground_part, data, counter, room,
         box, out):
    n_times = int(data[2])
    dt = data[1]
    tolerance = 1e-9 * dt
    used = 0
    flag = 0
    event = next_event(data)
    if event < np.inf:
        CVodeSetStopTime(memory, event)
    for j in range(n_times):
        now = j * dt
        end = (j + 1) * dt
        slope = y[1]
        drive(y, data, j)
        if DRIVEN:
            if j > 0 and y[1] != slope:
                start_anew(memory, vector, pointers, now, event)
        rates(y, ground_at(now, data), room[0], data)
        observe(y, tangents, starts, row, coefficient, ground_part, data, room[0],
                out[j * (1 + tangents.shape[0]):], j)
        if j + 1 == n_times:
            break
        while now < end and flag >= 0:
            until = event if event < end - tolerance else end
            if DRIVEN:
                CVodeSetStopTime(memory, until)
            flag = carry(memory, vector, pointers, until, max_steps, used, counter, box)
            now = until
            if flag >= 0 and event <= until + tolerance:
                strike(until + tolerance, ground_at(now, data), y, tangents, room[0], room[1], data)
                used += counter[0]
                event = next_event(data)
                start_anew(memory, vector, pointers, now, event)
        if flag < 0:
            break
    return flag


def run_cvodes(stiff: bool, rtol: float, atol: float, max_steps: int, scales: floats, starts: integers, row: integers,
               coefficient: floats, ground_part: floats, data: floats, state: floats_2d, pointers: integers,
               counter: integers, room: floats_2d, box: floats, out: floats_2d) -> int:
    # Solve one draw; every object of the library is made and freed here. Returns a flag of CVODES.
    n = state.shape[1]
    n_directions = state.shape[0] - 1
    y = state[0]
    tangents = state[1:]
    SUNContext_Create(0, counter)
    context = counter[0]
    SUNContext_ClearErrHandlers(context)
    vector = N_VMake_Serial(n, y, context)
    prepare(data)
    drive(y, data, 0)
    strike(1e-9 * data[1], 0.0, y, tangents[n_directions:], room[0], room[1], data)
    memory = CVodeCreate(2 if stiff else 1, context)
    CVodeInit(memory, rates_callback, 0.0, vector)
    CVodeSStolerances(memory, rtol, atol)
    CVodeSetUserData(memory, data)
    CVodeSetMaxNumSteps(memory, max_steps)
    CVodeSetMaxHnilWarns(memory, -1)
    matrix = 0
    linear = 0
    nonlinear = 0
    nonlinear_tangents = 0
    if stiff:
        matrix = SUNDenseMatrix(n, n, context)
        linear = SUNLinSol_Dense(vector, matrix, context)
        CVodeSetLinearSolver(memory, linear, matrix)
        CVodeSetJacFn(memory, jacobian_callback)
    else:
        nonlinear = SUNNonlinSol_FixedPoint(vector, 0, context)
        CVodeSetNonlinearSolver(memory, nonlinear)
    if WITH_TANGENTS:
        for k in range(n_directions):
            pointers[k] = N_VMake_Serial(n, tangents[k], context)
        CVodeSensInit(memory, n_directions, 2, tangents_callback, pointers)
        CVodeSetSensParams(memory, 0, scales, 0)
        CVodeSensEEtolerances(memory)
        CVodeSetSensErrCon(memory, 1)
        if not stiff:
            nonlinear_tangents = SUNNonlinSol_FixedPointSens(n_directions, vector, 0, context)
            CVodeSetNonlinearSolverSensStg(memory, nonlinear_tangents)
    flag = walk(memory, vector, pointers, y, tangents, max_steps, starts, row, coefficient, ground_part, data, counter,
                room, box, out)
    counter[0] = memory
    CVodeFree(counter)
    if stiff:
        SUNLinSolFree(linear)
        SUNMatDestroy(matrix)
    else:
        SUNNonlinSolFree(nonlinear)
        if WITH_TANGENTS:
            SUNNonlinSolFree(nonlinear_tangents)
    for k in range(n_directions):
        N_VDestroy(pointers[k])
    N_VDestroy(vector)
    counter[0] = context
    SUNContext_Free(counter)
    return flag
"""
