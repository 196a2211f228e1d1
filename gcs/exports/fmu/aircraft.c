/* Motion of a rigid aircraft over a flat earth, as an FMU for co-simulation (FMI 2.0).
 *
 * Equations of Stevens & Lewis, Aircraft Control and Simulation, ch. 1.7 and 3, with Ixz; aerodynamics are sums of
 * terms (model.h). Classical fourth-order Runge-Kutta; inputs are held over a communication step.
 * SI units and rad. Body axes x forward, y right, z down; earth axes north, east, down.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "model.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* The interface's types and numbers, FMI for Model Exchange and Co-Simulation 2.0.1, sections 2.1.2 and 2.1.3. */
typedef void *fmi2Component, *fmi2ComponentEnvironment, *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer, fmi2Boolean;
typedef char fmi2Char, fmi2Byte;
typedef const fmi2Char *fmi2String;
typedef int fmi2Status, fmi2Type, fmi2StatusKind;
enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending };
typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment environment;
} fmi2CallbackFunctions;

enum { NORTH, EAST, DOWN, U, V_BODY, W, Q0, Q1, Q2, Q3, P, Q, R, STATES };
/* Angles of the air and nondimensional rates, deflections, lift, throttle: what terms are products of. */
enum { R_ALPHA, R_ALPHADOT, R_BETA, R_P, R_Q, R_R, R_DE, R_DA, R_DR, R_CL, R_THROTTLE, REGRESSORS };
enum { AXIS_CL, AXIS_CD, AXIS_CY, AXIS_ROLL, AXIS_PITCH, AXIS_YAW, AXES };

typedef struct {
    double value[VARIABLES]; /* all variables by their value references, outputs as of the last step */
    double x[STATES];
    double actuator[4]; /* de, da, dr, throttle behind their lags */
    double time;
    int ready;
} Aircraft;

typedef struct {
    fmi2CallbackFunctions call;
    char name[128];
    Aircraft now;
} Instance;

static double density(const double *v, double height) {
    if (v[V_AIR_DENSITY] > 0.0) return v[V_AIR_DENSITY];
    /* ICAO Doc 7488/3 below 11 km. */
    double temperature = 288.15 - 0.0065 * height;
    return 101325.0 * pow(temperature / 288.15, STANDARD_GRAVITY / (GAS_CONSTANT * 0.0065)) / (GAS_CONSTANT * temperature);
}

/* Sum of the terms of an axis. tail: factor on what the elevator does to the pitching moment; drag: on CD_0. */
static double axis_sum(const double *v, int axis, const double *r, double tail, double drag) {
    double total = 0.0;
    for (int i = 0; i < TERMS; i++) {
        if (TERM_AXIS[i] != axis) continue;
        double value = v[TERM_FIRST + i];
        for (int j = 0; j < 4 && TERM_FACTORS[i][j] >= 0; j++) value *= r[TERM_FACTORS[i][j]];
        if (TERM_KIND[i] == 1) value *= tail;
        if (TERM_KIND[i] == 2) value *= drag;
        total += value;
    }
    return total;
}

static double separated(const double *v, double alpha) {
    /* Beard & McLain, Small Unmanned Aircraft, eq. (4.10). */
    double above = exp(-v[V_STALL_SHARPNESS] * (alpha - v[V_STALL_ALPHA]));
    double below = exp(v[V_STALL_SHARPNESS] * (alpha + v[V_STALL_ALPHA]));
    return (1.0 + above + below) / ((1.0 + above) * (1.0 + below));
}

static double lift(const double *v, const double *r) {
    double total = axis_sum(v, AXIS_CL, r, 1.0, 1.0), alpha = r[R_ALPHA];
    if (!HAS_STALL) return total;
    double share = separated(v, alpha);
    return (1.0 - share) * total + share * copysign(2.0, alpha) * sin(alpha) * sin(alpha) * cos(alpha);
}

/* A curve over the advance ratio: pieces of powers, straight on beyond its ends. */
static double curve(const double *c, double J) {
    int count = (int)c[0], piece = 0;
    double inside = fmin(fmax(J, c[2]), c[1]);
    while (piece + 1 < count && inside >= c[2 + (piece + 1) * CURVE_PIECE]) piece++;
    const double *begin = c + 2 + piece * CURVE_PIECE;
    double x = inside - begin[0], value = 0.0, slope = 0.0;
    for (int i = CURVE_PIECE - 1; i > 0; i--) {
        slope = slope * x + value;
        value = value * x + begin[i];
    }
    return value + slope * (J - inside);
}

/* Rates of the state with surfaces and throttle `s`; what is shown of the motion goes to `shown`, if that is given. */
static void rates(const double *v, const double *x, const double *s, double *rate, double *shown) {
    double q0 = x[Q0], q1 = x[Q1], q2 = x[Q2], q3 = x[Q3], p = x[P], q = x[Q], r = x[R];
    double r11 = q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3, r12 = 2.0 * (q1 * q2 + q0 * q3), r13 = 2.0 * (q1 * q3 - q0 * q2);
    double r21 = 2.0 * (q1 * q2 - q0 * q3), r22 = q0 * q0 - q1 * q1 + q2 * q2 - q3 * q3, r23 = 2.0 * (q2 * q3 + q0 * q1);
    double r31 = 2.0 * (q1 * q3 + q0 * q2), r32 = 2.0 * (q2 * q3 - q0 * q1), r33 = q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3;
    double wn = v[V_WIND_NORTH], we = v[V_WIND_EAST], wd = v[V_WIND_DOWN];
    double ua = x[U] - (r11 * wn + r12 * we + r13 * wd);
    double va = x[V_BODY] - (r21 * wn + r22 * we + r23 * wd);
    double wa = x[W] - (r31 * wn + r32 * we + r33 * wd);
    double V = fmax(sqrt(ua * ua + va * va + wa * wa), 0.1);
    double alpha = atan2(wa, ua), beta = asin(fmin(fmax(va / V, -1.0), 1.0));
    double rho = density(v, -x[DOWN]), mass = v[V_MASS] * (1.0 + v[V_MASS_ERROR]);
    double qbar = 0.5 * rho * V * V, qS = qbar * v[V_S], b = v[V_B], c = v[V_C], g = v[V_GRAVITY];

    double thrust, torque = 0.0, n = fmax(s[3] * v[V_FULL_REVOLUTIONS], 1e-3), D = v[V_DIAMETER];
    thrust = HAS_CT ? rho * n * n * D * D * D * D * curve(CT, V / (n * D)) : v[V_MAX_THRUST] * s[3];
    if (HAS_CQ) torque = TURNING * rho * n * n * D * D * D * D * D * curve(CQ, V / (n * D));
    thrust += s[3] * v[V_THRUST_BY_SPEED] * (V - REFERENCE_SPEED);
    thrust *= 1.0 + v[V_THRUST_SCALE];
    double along = cos(INCLINATION), across = sin(INCLINATION), fx = thrust * along, fz = -thrust * across;
    double L = -PROPELLER_Y * thrust * across - torque * along;
    double M = PROPELLER_Z * fx - PROPELLER_X * fz + v[V_THRUST_LINE] * thrust;
    double N = -PROPELLER_Y * fx + torque * across;

    double reg[REGRESSORS + NAMED] = {alpha, 0.0, beta, p * b / (2.0 * V), q * c / (2.0 * V), r * b / (2.0 * V),
                                      s[0], s[1], s[2], 0.0, s[3]};
    for (int i = 0; i < NAMED; i++) reg[REGRESSORS + i] = v[V_NAMED + i];
    double plane = sqrt(ua * ua + wa * wa), ca = plane > 0.0 ? ua / plane : 1.0, sa = plane > 0.0 ? wa / plane : 0.0;
    double CL = lift(v, reg);
    if (HAS_ALPHADOT) {
        /* The rate of the angle of attack hangs on the lift itself, linearly. */
        double flow2 = fmax(ua * ua + wa * wa, 0.01), half = c / (2.0 * V);
        double ud = fx / mass + qS * CL * sa / mass + g * r13 + r * va - q * wa;
        double wdot = fz / mass - qS * CL * ca / mass + g * r33 + q * ua - p * va;
        reg[R_ALPHADOT] = 1.0;
        double slope = lift(v, reg) - CL;
        reg[R_ALPHADOT] = half * (ua * wdot - wa * ud) / flow2 / (1.0 + qS / mass * slope * half / sqrt(flow2));
        CL += slope * reg[R_ALPHADOT];
    }
    reg[R_CL] = CL;
    double usual = 0.5 * SEA_LEVEL_DENSITY * REFERENCE_SPEED * REFERENCE_SPEED;
    double tail = (1.0 + v[V_PROPWASH] * thrust / qS) * (1.0 - v[V_ELASTIC_TAIL] * (qbar / usual - 1.0));
    double CD = axis_sum(v, AXIS_CD, reg, 1.0, pow(V / REFERENCE_SPEED, -v[V_REYNOLDS]));
    if (HAS_STALL) CD += separated(v, alpha) * 2.0 * pow(fabs(sin(alpha)), 3.0);
    double CY = axis_sum(v, AXIS_CY, reg, 1.0, 1.0), Cl = axis_sum(v, AXIS_ROLL, reg, 1.0, 1.0);
    double Cm = axis_sum(v, AXIS_PITCH, reg, tail, 1.0), Cn = axis_sum(v, AXIS_YAW, reg, 1.0, 1.0);
    double ax = (fx + qS * (-CD * ca + CL * sa)) / mass, ay = qS * CY / mass, az = (fz + qS * (-CD * sa - CL * ca)) / mass;
    L += qS * b * Cl;
    M += qS * c * Cm + v[V_CG_SHIFT] * mass * az;
    N += qS * b * Cn - v[V_CG_SHIFT] * mass * ay;

    double inertia = 1.0 + v[V_INERTIA_ERROR];
    double Ixx = v[V_IXX] * inertia, Iyy = v[V_IYY] * inertia, Izz = v[V_IZZ] * inertia, Ixz = v[V_IXZ] * inertia;
    double left = L + Ixz * p * q - (Izz - Iyy) * q * r, right = N - Ixz * q * r - (Iyy - Ixx) * p * q;
    double determinant = Ixx * Izz - Ixz * Ixz;
    double u = x[U], vb = x[V_BODY], w = x[W];
    rate[NORTH] = r11 * u + r21 * vb + r31 * w;
    rate[EAST] = r12 * u + r22 * vb + r32 * w;
    rate[DOWN] = r13 * u + r23 * vb + r33 * w;
    rate[U] = ax + g * r13 + r * vb - q * w;
    rate[V_BODY] = ay + g * r23 + p * w - r * u;
    rate[W] = az + g * r33 + q * u - p * vb;
    rate[Q0] = 0.5 * (-q1 * p - q2 * q - q3 * r);
    rate[Q1] = 0.5 * (q0 * p + q2 * r - q3 * q);
    rate[Q2] = 0.5 * (q0 * q - q1 * r + q3 * p);
    rate[Q3] = 0.5 * (q0 * r + q1 * q - q2 * p);
    rate[P] = (Izz * left + Ixz * right) / determinant;
    rate[Q] = (M - (Ixx - Izz) * p * r - Ixz * (p * p - r * r)) / Iyy;
    rate[R] = (Ixz * left + Ixx * right) / determinant;
    if (!shown) return;
    const double all[OUTPUTS] = {
        V, alpha, beta, p, q, r, atan2(r23, r33), asin(fmin(fmax(-r13, -1.0), 1.0)), atan2(r12, r11), ax, ay, az,
        x[NORTH], x[EAST], x[DOWN], rate[NORTH], rate[EAST], rate[DOWN], thrust, CL, CD, CY, Cl, Cm, Cn,
    };
    memcpy(shown, all, sizeof all);
}

static void show(Aircraft *a) {
    double rate[STATES];
    rates(a->value, a->x, a->actuator, rate, a->value + OUTPUT_FIRST);
}

/* Put the aircraft into the state that the start values give, actuators at rest at their inputs. */
static void begin(Aircraft *a) {
    const double *v = a->value;
    double f = 0.5 * v[V_START_PHI], t = 0.5 * v[V_START_THETA], y = 0.5 * v[V_START_PSI];
    double sf = sin(f), cf = cos(f), st = sin(t), ct = cos(t), sy = sin(y), cy = cos(y);
    double x[STATES] = {
        v[V_START_NORTH], v[V_START_EAST], v[V_START_DOWN], v[V_START_U], v[V_START_V], v[V_START_W],
        cf * ct * cy + sf * st * sy, sf * ct * cy - cf * st * sy, cf * st * cy + sf * ct * sy,
        cf * ct * sy - sf * st * cy, v[V_START_P], v[V_START_Q], v[V_START_R],
    };
    memcpy(a->x, x, sizeof x);
    memcpy(a->actuator, v + V_DE, sizeof a->actuator);
    a->ready = 1;
    show(a);
}

/* Advance a lag of the first order; its mean over the step is what the motion feels. */
static double lagged(double *state, double command, double step, double tau) {
    if (tau <= 0.0) return *state = command;
    double off = *state - command, share = -expm1(-step / tau) * tau / step;
    *state = command + off * exp(-step / tau);
    return command + off * share;
}

static void advance(Aircraft *a, double step) {
    const double *v = a->value;
    double s[4], k1[STATES], k2[STATES], k3[STATES], k4[STATES], y[STATES];
    for (int i = 0; i < 4; i++) s[i] = lagged(&a->actuator[i], v[V_DE + i], step, i < 3 ? v[V_ACTUATOR_LAG] : v[V_MOTOR_LAG]);
    rates(v, a->x, s, k1, NULL);
    for (int i = 0; i < STATES; i++) y[i] = a->x[i] + 0.5 * step * k1[i];
    rates(v, y, s, k2, NULL);
    for (int i = 0; i < STATES; i++) y[i] = a->x[i] + 0.5 * step * k2[i];
    rates(v, y, s, k3, NULL);
    for (int i = 0; i < STATES; i++) y[i] = a->x[i] + step * k3[i];
    rates(v, y, s, k4, NULL);
    for (int i = 0; i < STATES; i++) a->x[i] += step / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
    double size = sqrt(a->x[Q0] * a->x[Q0] + a->x[Q1] * a->x[Q1] + a->x[Q2] * a->x[Q2] + a->x[Q3] * a->x[Q3]);
    for (int i = Q0; i <= Q3; i++) a->x[i] /= size;
}

static fmi2Status say(Instance *m, fmi2Status status, const char *text) {
    if (m->call.logger) m->call.logger(m->call.environment, m->name, status, "logStatusError", "%s", text);
    return status;
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) {
    (void)c, (void)on, (void)n, (void)names;
    return fmi2OK;
}

EXPORT fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                     const fmi2CallbackFunctions *call, fmi2Boolean visible, fmi2Boolean logging) {
    (void)resources, (void)visible, (void)logging;
    if (type != 1 || !guid || strcmp(guid, GUID) != 0) {
        if (call && call->logger)
            call->logger(call->environment, name, fmi2Error, "logStatusError",
                         type != 1 ? "this FMU is for co-simulation" : "the library is not that of modelDescription.xml");
        return NULL;
    }
    Instance *m = calloc(1, sizeof *m);
    if (!m) return NULL;
    if (call) m->call = *call;
    strncpy(m->name, name ? name : "", sizeof m->name - 1);
    memcpy(m->now.value, START, sizeof START);
    return m;
}

EXPORT void fmi2FreeInstance(fmi2Component c) { free(c); }

EXPORT fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_set, fmi2Real tolerance, fmi2Real start,
                                      fmi2Boolean stop_set, fmi2Real stop) {
    (void)tolerance_set, (void)tolerance, (void)stop_set, (void)stop;
    ((Instance *)c)->now.time = start;
    return fmi2OK;
}

EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    (void)c;
    return fmi2OK;
}

EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    begin(&((Instance *)c)->now);
    return fmi2OK;
}

EXPORT fmi2Status fmi2Terminate(fmi2Component c) {
    (void)c;
    return fmi2OK;
}

EXPORT fmi2Status fmi2Reset(fmi2Component c) {
    Aircraft *a = &((Instance *)c)->now;
    memset(a, 0, sizeof *a);
    memcpy(a->value, START, sizeof START);
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    Instance *m = c;
    if (!m->now.ready) begin(&m->now), m->now.ready = 0;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] >= VARIABLES) return say(m, fmi2Error, "there is no such value reference");
        value[i] = m->now.value[vr[i]];
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    Instance *m = c;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] >= OUTPUT_FIRST) return say(m, fmi2Error, "an output, or no variable at all, cannot be set");
        if (!isfinite(value[i])) return say(m, fmi2Error, "a value that is set is not finite");
        m->now.value[vr[i]] = value[i];
    }
    return fmi2OK;
}

#define NONE_OF(kind, type)                                                                                              \
    EXPORT fmi2Status fmi2Get##kind(fmi2Component c, const fmi2ValueReference vr[], size_t n, type value[]) {            \
        (void)vr, (void)value;                                                                                           \
        return n ? say(c, fmi2Error, "all variables are Real") : fmi2OK;                                                 \
    }                                                                                                                    \
    EXPORT fmi2Status fmi2Set##kind(fmi2Component c, const fmi2ValueReference vr[], size_t n, const type value[]) {      \
        (void)vr, (void)value;                                                                                           \
        return n ? say(c, fmi2Error, "all variables are Real") : fmi2OK;                                                 \
    }
NONE_OF(Integer, fmi2Integer)
NONE_OF(Boolean, fmi2Boolean)
NONE_OF(String, fmi2String)

EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real at, fmi2Real size, fmi2Boolean final) {
    (void)final;
    Instance *m = c;
    Aircraft *a = &m->now;
    if (!(size > 0.0)) return say(m, fmi2Error, "a communication step is not above 0");
    int steps = (int)ceil(size / a->value[V_MAX_STEP] - 1e-9);
    if (steps < 1) steps = 1;
    for (int i = 0; i < steps; i++) advance(a, size / steps);
    a->time = at + size;
    show(a);
    for (int i = 0; i < STATES; i++)
        if (!isfinite(a->x[i])) return say(m, fmi2Error, "the flight has diverged: the model holds nothing of such a motion");
    return fmi2OK;
}

EXPORT fmi2Status fmi2CancelStep(fmi2Component c) {
    return say(c, fmi2Error, "no step is ever pending");
}

EXPORT fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (!*state && !(*state = malloc(sizeof(Aircraft)))) return say(c, fmi2Error, "out of memory");
    memcpy(*state, &((Instance *)c)->now, sizeof(Aircraft));
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    memcpy(&((Instance *)c)->now, state, sizeof(Aircraft));
    return fmi2OK;
}

EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

EXPORT fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    (void)c, (void)state;
    *size = sizeof(Aircraft);
    return fmi2OK;
}

EXPORT fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    if (size < sizeof(Aircraft)) return say(c, fmi2Error, "too few bytes for the state");
    memcpy(bytes, state, sizeof(Aircraft));
    return fmi2OK;
}

EXPORT fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    if (size != sizeof(Aircraft)) return say(c, fmi2Error, "bytes of another FMU's state");
    if (!*state && !(*state = malloc(sizeof(Aircraft)))) return say(c, fmi2Error, "out of memory");
    memcpy(*state, bytes, sizeof(Aircraft));
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n,
                                               const fmi2ValueReference known[], size_t k, const fmi2Real seed[],
                                               fmi2Real value[]) {
    (void)unknown, (void)n, (void)known, (void)k, (void)seed, (void)value;
    return say(c, fmi2Error, "no directional derivatives");
}

EXPORT fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                              const fmi2Integer order[], const fmi2Real value[]) {
    (void)vr, (void)order, (void)value;
    return n ? say(c, fmi2Error, "inputs are held") : fmi2OK;
}

EXPORT fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                               const fmi2Integer order[], fmi2Real value[]) {
    (void)vr, (void)order, (void)value;
    return n ? say(c, fmi2Error, "no derivatives of outputs") : fmi2OK;
}

EXPORT fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) {
    (void)c, (void)kind;
    *value = fmi2OK;
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    (void)kind;
    *value = ((Instance *)c)->now.time;
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value) {
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}

EXPORT fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    (void)c, (void)kind;
    *value = 0;
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value) {
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}
