/* PComm32's functions under their own names, over libPComm32W.so.
 *
 * Written from the names, types and layouts that public programs of PComm32 use. A `long` of Windows is a LONG here, so
 * that values and structures keep their size. Text that a function only reads is `LPCSTR`. Where public declarations
 * disagree, the one that fits every caller stands here. */
#ifndef PCOMM32_PMACU_H
#define PCOMM32_PMACU_H

#include <windows.h>

#ifdef __cplusplus
#define PCOMM32_SIZE(type, bytes) static_assert(sizeof(type) == (bytes), #type " has the size that it has on Windows")
extern "C" {
#else
#define PCOMM32_SIZE(type, bytes) _Static_assert(sizeof(type) == (bytes), #type " has the size that it has on Windows")
#endif

/* The upper four bits of a ...Ex function's result are its state; the rest counts characters. */
#define COMM_EOT 0x80000000u
#define COMM_TIMEOUT 0xC0000000u
#define COMM_BADCKSUM 0xD0000000u
#define COMM_ERROR 0xE0000000u
#define COMM_FAIL 0xF0000000u
#define COMM_ANYERR 0x70000000u
#define COMM_UNSOLICITED 0x10000000u
#define COMM_CHARS(c) ((c) & 0x0FFFFFFFu)
#define COMM_STATUS(c) ((c) & 0xF0000000u)
#define IS_COMM_MORE(c) (COMM_STATUS(c) == 0)
#define IS_COMM_EOT(c) (COMM_STATUS(c) == COMM_EOT)
#define IS_COMM_TIMEOUT(c) (COMM_STATUS(c) == COMM_TIMEOUT)
#define IS_COMM_BADCKSUM(c) (COMM_STATUS(c) == COMM_BADCKSUM)
#define IS_COMM_ERROR(c) (COMM_STATUS(c) == COMM_ERROR)
#define IS_COMM_FAIL(c) (COMM_STATUS(c) == COMM_FAIL)
#define IS_COMM_ANYERROR(c) (((c) & COMM_ANYERR) > 0)
#define IS_COMM_UNSOLICITED(c) (COMM_STATUS(c) == COMM_UNSOLICITED)

#define NO_PMAC_DEVICE 0xFFFFFFFFu
#define PMAC_DPR_BASE 0xD000
#define TURBO_DPR_BASE 0x60000
#define MAX_COMM_BUFFER 256
#define MAX_VBGBUF_USERS 9

typedef enum { BUS, DPR, SER } ASCIIMODE;
typedef enum { LT_UNKNOWN, LT_ISA, LT_SER, LT_ETH, LT_PCI, LT_USB } LOCATIONTYPE;
typedef enum { PT_PMAC1 = 1, PT_PMAC2, PT_PMACU, PT_PMAC, PT_PMAC1T, PT_PMAC2T, PT_PMACUT } PMACDEVICETYPE;
typedef enum { stop, run, step, hold, joghold, jogstop } PROGRAM;
typedef enum { inpos, jog, running, homing, handle, openloop, disabled } MOTION;
typedef enum { linear, rapid, circw, circcw, spline, pvt } MOTIONMODE;
typedef enum { GAT_RAM_NOWRAP, GAT_RAM_WRAP, GAT_DPR_NOWRAP, GAT_DPR_WRAP } GATMODE;
/* A rotary buffer took the line; is full: repeat with an empty line; the file has ended. Below zero: -59 no memory, -60
 * the number does not fit, -61 no number, -62 no command, -63 the integer is too large, -70 syntax. */
typedef enum { DprOk = 0, DprBufBsy = 1, DprEOF = 2 } DPRROTSTATUS;
#define RET_OKAY 0
#define RET_BUSY 1
#define RET_ERROR (-1)

typedef void(WINAPI *DOWNLOADMSGPROC)(LPSTR text, BOOL newline);
typedef LONG(WINAPI *DOWNLOADGETPROC)(LONG index, LPSTR text, LONG max);
typedef void(WINAPI *DOWNLOADPROGRESS)(LONG percent);
typedef void(WINAPI *DPRTESTMSGPROC)(LONG errors, LPSTR action, LONG offset);
typedef void(WINAPI *DPRTESTPROGRESS)(LONG percent);

typedef struct _INTRBUFFER {
    PCH lpData;
    ULONG dwBufferLength;
    DWORD dwInterruptType;
} INTRBUFFER, *PINTRBUFFER;
typedef void(WINAPI *PMACINTRPROC)(DWORD message, PINTRBUFFER buffer);

typedef struct _USER_HANDLE USER_HANDLE, *PUSER_HANDLE;

/* The first status word of a motor. The fields of these structures begin at bit 0. */
typedef struct ss {
    USHORT internal1 : 8, internal2 : 2, home_search : 1, block_request : 1, rffu1 : 1, desired_vel_0 : 1,
        data_block_err : 1, dwelling : 1;
    USHORT integration : 1, run_program : 1, open_loop : 1, phased_motor : 1, handwheel_ena : 1, pos_limit : 1,
        neg_limit : 1, activated : 1, pad : 8;
} SERVOSTATUS;
PCOMM32_SIZE(struct ss, 4);

typedef struct ssTURBO {
    USHORT rapid_spd_sel : 1, dac_sign_mag : 1, sw_capture : 1, fe_capture : 1, handwheel_ena : 1, hw_mode : 1,
        phased_motor : 1, yenc_phase : 1, user_servo : 1, user_phase : 1, home_search : 1, block_request : 1,
        limit_stop : 1, desired_vel_0 : 1, data_block_err : 1, dwelling : 1;
    USHORT integrator_ena : 1, run_program : 1, open_loop : 1, amp_enabled : 1, algo_ena : 1, pos_limit : 1,
        neg_limit : 1, activated : 1, pads : 8;
} SERVOSTATUSTURBO;
PCOMM32_SIZE(struct ssTURBO, 4);

/* The second status word of a Turbo's motor. */
typedef struct msTURBO {
    USHORT in_position : 1, warn_ferr : 1, fatal_ferr : 1, amp_fault : 1, backlash_dir : 1, amp_i2t_err : 1,
        integral_ferr : 1, triger_home_flg : 1, phase_find_err : 1, tbd09 : 1, home_complete : 1, stopped_on_limit : 1,
        : 3, cs_assigned : 1;
    USHORT cs_def : 4, coord_sys : 4, padm : 8;
} MOTORSTATUSTURBO;
PCOMM32_SIZE(struct msTURBO, 4);

/* The two global status words. */
typedef struct gs {
    USHORT rffu2 : 8, internal1 : 3, buffer_full : 1, internal2 : 3, dpram_response : 1;
    USHORT plc_command : 1, plc_buf_open : 1, rot_buf_open : 1, prog_buf_open : 1, internal3 : 2, host_comm_mode : 1,
        internal4 : 1, pad2 : 8;
    USHORT rffu1 : 7, end_gather : 1, rapid_m_flag : 1, rti_warning : 1, earom_error : 1, dpram_error : 1,
        prom_checksum : 1, mem_checksum : 1, comp_on : 1, stimulate_on : 1;
    USHORT stimulus_ent : 1, prep_trig_gat : 1, prep_next_serv : 1, data_gat_on : 1, servo_err : 1, servo_active : 1,
        intr_reentry : 1, intr_active : 1, pad1 : 8;
} GLOBALSTATUS;
PCOMM32_SIZE(struct gs, 8);

typedef struct gsTURBO {
    USHORT rffu2 : 8, internal1 : 3, buffer_full : 1, internal2 : 4;
    USHORT internal3 : 1, plc_buf_open : 1, rot_buf_open : 1, prog_buf_open : 1, bin_rot_buf_open : 1, internal4 : 3,
        pad2 : 8;
    USHORT card_adrssed : 1, all_adrssed : 1, rffu1 : 2, ring_error : 1, ring_io_error : 1, tws_error : 1,
        end_gather : 1, rapid_m_flag : 1, rti_warning : 1, earom_error : 1, dpram_error : 1, prom_checksum : 1,
        mem_checksum : 1, comp_on : 1, wdt1 : 1;
    USHORT wdt2 : 1, ext_trig_gat : 1, prep_trig_gat : 1, data_gat_on : 1, servo_err : 1, servo_active : 1,
        intr_reentry : 1, intr_active : 1, pad1 : 8;
} GLOBALSTATUSTURBO;
PCOMM32_SIZE(struct gsTURBO, 8);

/* A motor's block of the servo data buffer, as the DPRAM holds it. */
struct realm {
    LONG dpos[2], apos[2], hwpos[2], cpos[2];
    ULONG pdac;
    struct ss sstatus;
    LONG fvel, movtim;
    ULONG mspare[3];
};
PCOMM32_SIZE(struct realm, 60);

struct realmTURBO {
    LONG pepos[2], pdac;
    struct ssTURBO sstatus;
    struct msTURBO mstatus;
    LONG bpos[2], fvel, mspare[2], pos[2];
};
PCOMM32_SIZE(struct realmTURBO, 48);

/* An entry of the buffer by which the host writes variables. */
struct VBGWFormat {
    LONG type_addr, data1, data2;
};
PCOMM32_SIZE(struct VBGWFormat, 12);

typedef struct {
    BOOL plc_enabled;
    UINT plc_start_addr, plc_end_addr, plc_size;
} PLC_STATUS_STRUCT;
typedef struct {
    BOOL plcc_loaded, plcc_enabled;
    UINT plcc_start_addr, plcc_end_addr, plcc_size;
} PLCC_STATUS_STRUCT;
typedef struct {
    UINT num_plc, num_plcc, I5;
    PLC_STATUS_STRUCT plc[32];
    PLCC_STATUS_STRUCT plcc[32];
} TOTAL_PLC_STATUS_STRUCT;
PCOMM32_SIZE(TOTAL_PLC_STATUS_STRUCT, 12 + 32 * 16 + 32 * 20);

typedef struct {
    DWORD dwNumActiveNodes, dwNumMACROStations, dwNodeActive[64], dwIsIONode[64], dwMACROStationID[64];
} ULTRALIGHT_INFO;
PCOMM32_SIZE(ULTRALIGHT_INFO, 776);

typedef struct _WTG_EX {
    UINT COM_TO_G, ENC_TO_G, DAC_TO_G, CUR_TO_G;
} WTG_EX, *PWTG_EX;
PCOMM32_SIZE(WTG_EX, 16);

/* The masks of a quick gather: a bit for each of motors 1 to 8. */
#define GATHER_COM1 0x00000001u
#define GATHER_ENC1 0x00000100u
#define GATHER_DAC1 0x00010000u
#define GATHER_CUR1 0x01000000u

/* Devices */
BOOL WINAPI OpenPmacDevice(DWORD device);
BOOL WINAPI ClosePmacDevice(DWORD device);
LONG WINAPI PmacSelect(HWND parent);
BOOL WINAPI PmacConfigure(HWND parent, DWORD device);
void WINAPI LockPmac(DWORD device);
void WINAPI ReleasePmac(DWORD device);
LONG WINAPI DrvNumberOfDevices(void);
DWORD WINAPI MapDeviceNumToEnumAndLocation(LOCATIONTYPE location, DWORD enumeration);
DWORD WINAPI MapLocAndEnumFromDeviceNum(DWORD device, LOCATIONTYPE *location, DWORD *enumeration);
BOOL WINAPI ShutdownPmacDevice(DWORD device, BOOL force);

/* Lines and answers */
int WINAPI PmacGetResponseA(DWORD device, PCHAR response, UINT max, LPCSTR command);
LONG WINAPI PmacGetResponseExA(DWORD device, PCHAR response, UINT max, LPCSTR command);
int WINAPI PmacSendLineA(DWORD device, LPCSTR line);
BOOL WINAPI PmacSetAsciiComm(DWORD device, ASCIIMODE mode);
void WINAPI PmacFlush(DWORD device);
int WINAPI PmacGetErrorStrA(DWORD device, PCHAR text, int max);
int WINAPI PmacGetLineA(DWORD device, PCHAR line, UINT max);
void WINAPI PmacSendCommandA(DWORD device, LPCSTR line);
int WINAPI PmacGetControlResponseA(DWORD device, PCHAR response, UINT max, CHAR control);
int WINAPI PmacGetError(DWORD device);
BOOL WINAPI PmacReadReady(DWORD device);
int WINAPI PmacGetBufferA(DWORD device, PCHAR text, UINT max);
double WINAPI PmacFollowError(DWORD device, int motor, double units);
ASCIIMODE WINAPI PmacGetAsciiComm(DWORD device);
int WINAPI PmacGetControlResponseExA(DWORD device, PCHAR response, UINT max, CHAR control);
int WINAPI PmacGetControlResponseExW(DWORD device, PWCHAR response, UINT max, WCHAR control);
int WINAPI PmacGetControlResponseW(DWORD device, PWCHAR response, UINT max, WCHAR control);
int WINAPI PmacGetLineExA(DWORD device, PCHAR line, UINT max);
int WINAPI PmacGetLineExW(DWORD device, PWCHAR line, UINT max);
int WINAPI PmacGetLineW(DWORD device, PWCHAR line, UINT max);
LONG WINAPI PmacGetResponseExW(DWORD device, PWCHAR response, UINT max, LPCWSTR command);
int WINAPI PmacGetResponseW(DWORD device, PWCHAR response, UINT max, LPCWSTR command);
BOOL WINAPI PmacSendCharA(DWORD device, CHAR character);
int WINAPI PmacSendLineW(DWORD device, LPCWSTR line);

/* Variables */
double WINAPI PmacGetVariableDouble(DWORD device, CHAR letter, UINT number, double if_unknown);
void WINAPI PmacSetVariable(DWORD device, CHAR letter, UINT number, SHORT value);
void WINAPI PmacSetVariableDouble(DWORD device, CHAR letter, UINT number, double value);
SHORT WINAPI PmacGetVariable(DWORD device, CHAR letter, UINT number, SHORT if_unknown);
void WINAPI PmacSetIVariableDouble(DWORD device, UINT number, double value);
LONG WINAPI PmacGetVariableLong(DWORD device, CHAR letter, UINT number, LONG if_unknown);
double WINAPI PmacGetIVariableDouble(DWORD device, UINT number, double if_unknown);
LONG WINAPI PmacGetIVariableLong(DWORD device, UINT number, LONG if_unknown);
BOOL WINAPI PmacGetVariableStrA(DWORD device, CHAR letter, PCHAR text, UINT number);
void WINAPI PmacSetIVariableLong(DWORD device, UINT number, LONG value);
void WINAPI PmacSetVariableLong(DWORD device, CHAR letter, UINT number, LONG value);

/* The board */
PCHAR WINAPI PmacGetRomDateA(DWORD device, PCHAR text, int max);
PCHAR WINAPI PmacGetRomVersionA(DWORD device, PCHAR text, int max);
int WINAPI PmacGetPmacType(DWORD device);
BOOL WINAPI PmacGetDpramAvailable(DWORD device);
WORD WINAPI PmacGetPlcStatus(DWORD device, TOTAL_PLC_STATUS_STRUCT *status);
WORD WINAPI PmacIsAnyPLCRunning(DWORD device);
BOOL WINAPI bPMACIsTurbo(DWORD device);

/* Downloads */
int WINAPI PmacDownloadA(DWORD device, DOWNLOADMSGPROC message, DOWNLOADGETPROC get, DOWNLOADPROGRESS progress,
    LPCSTR file, BOOL macro, BOOL map, BOOL log, BOOL download);
int WINAPI PmacDownloadProgress(BOOL checksums, BOOL always_show, HWND parent, DWORD device, LPCSTR file, BOOL macro,
    BOOL map, BOOL log, BOOL download);
void WINAPI DownloadGantryAutoTuningPLC(DWORD device, DWORD motor1, DWORD motor2, BOOL current_loop, BOOL no_jog,
    float travel, LONG time);
void WINAPI PmacAbortDownload(DWORD device);
int WINAPI PmacAddDownloadFileA(DWORD device, LPCSTR ini_file, LPCSTR user, LPCSTR file);
void WINAPI PmacDownloadFile(DWORD device, LPCSTR file);
int WINAPI PmacMultiDownloadA(DWORD device, DOWNLOADMSGPROC message, LPCSTR out_file, LPCSTR ini_file, LPCSTR user,
    BOOL macro, BOOL map, BOOL log, BOOL download);
int WINAPI PmacRemoveDownloadFileA(DWORD device, LPCSTR ini_file, LPCSTR user, LPCSTR file);
void WINAPI PmacSetMaxDownloadErrors(UINT max);
int WINAPI PmacThreadDownloadA(DWORD device, DOWNLOADMSGPROC message, DOWNLOADGETPROC get, DOWNLOADPROGRESS progress,
    LPCSTR file, BOOL macro, BOOL map, BOOL log, BOOL download);

/* Words of the DPRAM; an offset counts bytes */
PVOID WINAPI PmacDPRGetMem(DWORD device, DWORD offset, INT count, PVOID memory);
DWORD WINAPI PmacDPRGetDWord(DWORD device, UINT offset);
void WINAPI PmacDPRSetDWord(DWORD device, UINT offset, DWORD value);
PVOID WINAPI PmacDPRSetMem(DWORD device, DWORD offset, INT count, PVOID memory);
float WINAPI PmacDPRGetFloat(DWORD device, UINT offset);
void WINAPI PmacDPRSetFloat(DWORD device, UINT offset, double value);
WORD WINAPI PmacDPRGetWord(DWORD device, UINT offset);
void WINAPI PmacDPRSetWord(DWORD device, UINT offset, WORD value);
double WINAPI PmacDPRFloat(LONG *words, double scale);
double WINAPI PmacDPRLFixed(LONG *words, double scale);
LONG WINAPI PmacDPRAddressRange(DWORD device, BOOL upper, BOOL as_offsets);
BOOL WINAPI PmacDPRDWordBitSet(DWORD device, UINT offset, UINT bit);
DWORD WINAPI PmacDPRGetDWordMask(DWORD device, UINT offset, DWORD mask);
void WINAPI PmacDPRResetDWordBit(DWORD device, UINT offset, UINT bit);
void WINAPI PmacDPRSetDWordBit(DWORD device, UINT offset, UINT bit);
void WINAPI PmacDPRSetDWordMask(DWORD device, UINT offset, DWORD mask, BOOL on);

/* Motors and coordinate systems, from the DPRAM */
BOOL WINAPI PmacDPRBackground(DWORD device, int on);
double WINAPI PmacDPRGetCommandedPos(DWORD device, int motor, double units);
double WINAPI PmacDPRPosition(DWORD device, int motor, double units);
BOOL WINAPI PmacDPRRealTime(DWORD device, UINT period, int on);
BOOL WINAPI PmacDPRRealTimeEx(DWORD device, LONG motors, UINT period, int on);
void WINAPI PmacDPRSetMotors(DWORD device, UINT motors);
BOOL WINAPI PmacDPRAmpFault(DWORD device, int motor);
BOOL WINAPI PmacDPRUpdateRealTime(DWORD device);
double WINAPI PmacDPRGetVel(DWORD device, int motor, double units);
BOOL WINAPI PmacDPRBackgroundEx(DWORD device, int on, UINT period, UINT systems);
double WINAPI PmacDPRCommanded(DWORD device, int system, char axis);
double WINAPI PmacDPRGetBiasPos(DWORD device, int motor, double units);
double WINAPI PmacDPRGetTargetPos(DWORD device, int motor, double units);
BOOL WINAPI PmacDPROnNegativeLimit(DWORD device, int motor);
BOOL WINAPI PmacDPROnPositiveLimit(DWORD device, int motor);
BOOL WINAPI PmacDPRAmpEnabled(DWORD device, int motor);
BOOL WINAPI PmacDPRAvailable(DWORD device);
BOOL WINAPI PmacDPRDataBlock(DWORD device, int motor);
BOOL WINAPI PmacDPRFatalFError(DWORD device, int motor);
double WINAPI PmacDPRFollowError(DWORD device, int motor, double units);
void WINAPI PmacDPRGetCompensationPos(DWORD device, int motor, double units, double *position);
double WINAPI PmacDPRGetFeedRateMode(DWORD device, int system, BOOL *mode);
void WINAPI PmacDPRGetGlobalStatus(DWORD device, DWORD status[2]);
void WINAPI PmacDPRGetGlobalStatusTurbo(DWORD device, struct gsTURBO *status);
void WINAPI PmacDPRGetMasterPos(DWORD device, int motor, double units, double *position);
MOTION WINAPI PmacDPRGetMotorMotion(DWORD device, int motor);
DWORD WINAPI PmacDPRGetMoveTime(DWORD device, int motor);
DWORD WINAPI PmacDPRGetPrevDAC(DWORD device, int motor);
PROGRAM WINAPI PmacDPRGetProgramMode(DWORD device, int system);
int WINAPI PmacDPRGetServoTimer(DWORD device);
struct gs WINAPI PmacDPRGlobalStatus(DWORD device);
BOOL WINAPI PmacDPRHandwheelEnabled(DWORD device, int motor);
BOOL WINAPI PmacDPRHomeComplete(DWORD device, int motor);
BOOL WINAPI PmacDPRInposition(DWORD device, int motor);
BOOL WINAPI PmacDPRMotorEnabled(DWORD device, int motor);
struct realm WINAPI PmacDPRMotorRealtimeStruct(DWORD device, int motor);
struct realmTURBO WINAPI PmacDPRMotorRealtimeStructTurbo(DWORD device, int motor);
struct ssTURBO WINAPI PmacDPRMotorServoStatusTurbo(DWORD device, int motor);
struct msTURBO WINAPI PmacDPRMotorStatusTurbo(DWORD device, int motor);
BOOL WINAPI PmacDPROnPositionLimit(DWORD device, int motor);
BOOL WINAPI PmacDPROpenLoop(DWORD device, int motor);
void WINAPI PmacDPRPCITest(DWORD device);
LONG WINAPI PmacDPRPe(DWORD device, int system);
BOOL WINAPI PmacDPRPhasedMotor(DWORD device, int motor);
int WINAPI PmacDPRProgRemaining(DWORD device, int system);
void WINAPI PmacDPRRealTimeSetMotor(DWORD device, LONG motors);
BOOL WINAPI PmacDPRSysInposition(DWORD device, int system);
LONG WINAPI PmacDPRTest(DWORD device, DPRTESTMSGPROC message, DPRTESTPROGRESS progress);
LONG WINAPI PmacDPRTimeRemInMove(DWORD device, int system);
LONG WINAPI PmacDPRTimeRemInTATS(DWORD device, int system);
double WINAPI PmacDPRVectorVelocity(DWORD device, int count, const int *motors, const double *units);
double WINAPI PmacDPRVelocity(DWORD device, int motor, double units);
BOOL WINAPI PmacDPRWarnFError(DWORD device, int motor);
double WINAPI PmacNetActualPosition(DWORD device, int motor, double units);

/* Control panel */
BOOL WINAPI PmacDPRControlPanel(DWORD device, LONG on);
LONG WINAPI PmacDPRGetFOEnableBit(DWORD device, LONG system);
LONG WINAPI PmacDPRGetFOValue(DWORD device, LONG system);
LONG WINAPI PmacDPRGetHoldBit(DWORD device, LONG system);
LONG WINAPI PmacDPRGetHomeBit(DWORD device, LONG motor);
LONG WINAPI PmacDPRGetJogNegBit(DWORD device, LONG motor);
LONG WINAPI PmacDPRGetJogPosBit(DWORD device, LONG motor);
LONG WINAPI PmacDPRGetJogReturnBit(DWORD device, LONG motor);
LONG WINAPI PmacDPRGetRequestBit(DWORD device, LONG motor);
LONG WINAPI PmacDPRGetRunBit(DWORD device, LONG system);
LONG WINAPI PmacDPRGetStepBit(DWORD device, LONG system);
LONG WINAPI PmacDPRGetStopBit(DWORD device, LONG system);
void WINAPI PmacDPRSetFOEnableBit(DWORD device, LONG system, LONG on);
void WINAPI PmacDPRSetFOValue(DWORD device, LONG system, LONG value);
void WINAPI PmacDPRSetHoldBit(DWORD device, LONG system, LONG on);
void WINAPI PmacDPRSetHomeBit(DWORD device, LONG motor, LONG on);
void WINAPI PmacDPRSetJogNegBit(DWORD device, LONG motor, LONG on);
void WINAPI PmacDPRSetJogPosBit(DWORD device, LONG motor, LONG on);
void WINAPI PmacDPRSetJogReturnBit(DWORD device, LONG motor, LONG on);
void WINAPI PmacDPRSetRequestBit(DWORD device, LONG motor, LONG on);
void WINAPI PmacDPRSetRunBit(DWORD device, LONG system, LONG on);
void WINAPI PmacDPRSetStepBit(DWORD device, LONG system, LONG on);
void WINAPI PmacDPRSetStopBit(DWORD device, LONG system, LONG on);

/* Rotary motion program buffers */
SHORT WINAPI PmacDPRAsciiStrToRotA(DWORD device, LPCSTR line, USHORT buffer);
int WINAPI PmacDPRBufLast(DWORD device);
SHORT WINAPI PmacDPRRotBufChange(DWORD device, USHORT buffer, USHORT size);
SHORT WINAPI PmacDPRRotBufRemove(DWORD device, USHORT buffer);
SHORT WINAPI PmacDPRAsciiStrToRotEx(DWORD device, LPCSTR line, USHORT buffer, BOOL send_rest);
SHORT WINAPI PmacDPRRotBuf(DWORD device, BOOL on);
void WINAPI PmacDPRRotBufClr(DWORD device, UINT buffer);
SHORT WINAPI PmacDPRRotBufInit(DWORD device, USHORT buffer);
BOOL WINAPI PmacDPRRotBufOpen(DWORD device);
SHORT WINAPI PmacDPRrotput(DWORD device, int count, LPDWORD commands, int buffer);

/* Background variable buffers */
BOOL WINAPI PmacDPRBackGroundVar(DWORD device, BOOL on);
UINT WINAPI PmacDPRGetVBGServoTimer(DWORD device);
BOOL WINAPI PmacDPRVarBufChange(DWORD device, LONG handle, LONG count, LONG *addresses);
BOOL WINAPI PmacDPRVarBufChangeEx(DWORD device, LONG handle, LONG count, LONG *addresses, PUINT types);
LONG WINAPI PmacDPRVarBufInit(DWORD device, LONG count, PLONG addresses);
LONG WINAPI PmacDPRVarBufInitEx(DWORD device, LONG count, PLONG addresses, PUINT types);
BOOL WINAPI PmacDPRVarBufRead(DWORD device, LONG handle, LONG entry, PLONG words);
BOOL WINAPI PmacDPRVarBufReadEx(DWORD device, LONG handle, PLONG words);
BOOL WINAPI PmacDPRVarBufRemove(DWORD device, LONG handle);
int WINAPI PmacDPRWriteBuffer(DWORD device, int count, struct VBGWFormat *entries);
int WINAPI PmacDPRWriteBufferEx(DWORD device, int count, struct VBGWFormat *entries, LONG *addresses, UINT *types);

/* Data gathering */
BOOL WINAPI PmacAddRTGather(DWORD device, ULONG source);
void WINAPI PmacClearGather(DWORD device);
void WINAPI PmacClearGatherData(DWORD device);
void WINAPI PmacClearRTGather(DWORD device);
double *WINAPI PmacCollectGatherData(DWORD device, PUINT sources, PUINT samples);
double *WINAPI PmacCollectRTGatherData(DWORD device, PUINT sources);
BOOL WINAPI PmacGetGather(DWORD device, UINT number, PCHAR text, UINT max);
BOOL WINAPI PmacGetGatherEnable(DWORD device, UINT number);
UINT WINAPI PmacGetGatherPeriod(DWORD device);
BOOL WINAPI PmacGetGatherPoint(DWORD device, UINT source, UINT sample, double *value);
double WINAPI PmacGetGatherSampleTime(DWORD device);
BOOL WINAPI PmacGetGatherSamples(DWORD device, UINT source, PUINT samples, double *values, UINT max);
UINT WINAPI PmacGetNumGatherSamples(DWORD device);
UINT WINAPI PmacGetNumGatherSources(DWORD device);
BOOL WINAPI PmacInitGather(DWORD device, UINT size, double msec);
BOOL WINAPI PmacInitRTGather(DWORD device);
BOOL WINAPI PmacSetCurrentGather(DWORD device, UINT mask, BOOL enable);
BOOL WINAPI PmacSetGather(DWORD device, UINT number, LPCSTR text, BOOL enable);
BOOL WINAPI PmacSetGatherEnable(DWORD device, UINT number, BOOL enable);
UINT WINAPI PmacSetGatherPeriod(DWORD device, UINT period);
double WINAPI PmacSetGatherSampleTime(DWORD device, double msec);
BOOL WINAPI PmacSetQuickGather(DWORD device, UINT mask, BOOL enable);
BOOL WINAPI PmacSetQuickGatherEx(DWORD device, PWTG_EX mask, BOOL enable);
BOOL WINAPI PmacSetQuickGatherWithDirectCurrent(DWORD device, UINT mask, BOOL enable);
BOOL WINAPI PmacSetQuickGatherWithDirectCurrentEx(DWORD device, PWTG_EX mask, BOOL enable);
int WINAPI PmacStartGather(DWORD device);
int WINAPI PmacStopGather(DWORD device);

/* Interrupts */
BOOL WINAPI PmacINTRFuncCallInit(DWORD device, PMACINTRPROC callback, DWORD message, ULONG mask);
BOOL WINAPI PmacINTRTerminate(DWORD device);
BOOL WINAPI PmacINTRSetupMask(DWORD device, ULONG mask);
BOOL WINAPI PmacINTRWndMsgInit(DWORD device, HWND window, UINT message, ULONG mask);

/* Serial port */
int WINAPI PmacSERCheckGetLineA(DWORD device, PCHAR line, UINT max, PUINT count);
int WINAPI PmacSERCheckResponseA(DWORD device, PCHAR response, UINT max, LPCSTR command);
BOOL WINAPI PmacSERCheckSendLineA(DWORD device, LPCSTR line, PCHAR checksum);
int WINAPI PmacSERDoChecksums(DWORD device, UINT on);
DWORD WINAPI PmacSERGetBaudrate(DWORD device);
DWORD WINAPI PmacSERGetPort(DWORD device);
int WINAPI PmacSerCheckAllWentWell(DWORD device, int result, PCHAR text, CHAR checksum);

/* Others */
BOOL WINAPI InBufferedMode(DWORD device);
BOOL WINAPI ChangeGet(DWORD device, PCHAR text, UINT max);
BOOL WINAPI ChangeReadReady(DWORD device);
BOOL WINAPI ChangeStore(DWORD device, LPCSTR text);
void WINAPI DoAGantryParabolic(DWORD device, DWORD motor1, DWORD motor2);
void WINAPI DoAGantryPositionLoopStep(DWORD device, DWORD motor1, DWORD motor2);
BOOL WINAPI GetUSResponse(DWORD device, PCHAR text, UINT max);
LONG WINAPI MACROGetIVariableLong(DWORD device, DWORD node, UINT number, LONG if_unknown);
PCHAR WINAPI MACROGetIVariableString(DWORD device, DWORD node, UINT number, PCHAR if_unknown);
BOOL WINAPI MACROSetIVariableString(DWORD device, DWORD node, UINT number, LPCSTR value);
BOOL WINAPI MACROUploadConfig(DWORD device, DOWNLOADPROGRESS progress, LPCSTR file);
void WINAPI PmacAbortDPRTest(void);
BOOL WINAPI PmacAmpEnabled(DWORD device, int motor);
BOOL WINAPI PmacAmpFault(DWORD device, int motor);
BOOL WINAPI PmacDoChecksums(DWORD device, BOOL on);
BOOL WINAPI PmacFatalFError(DWORD device, int motor);
int WINAPI PmacGetEnumeration(DWORD device);
LOCATIONTYPE WINAPI PmacGetLocation(DWORD device);
BOOL WINAPI PmacGetMotorStatus(DWORD device, UINT motor, DWORD *status);
PUSER_HANDLE WINAPI PmacGetUserHandle(DWORD device);
BOOL WINAPI PmacInBootStrapMode(DWORD device);
void WINAPI PmacLMH(HANDLE *module);
BOOL WINAPI PmacOnNegativeLimit(DWORD device, int motor);
BOOL WINAPI PmacOnPositiveLimit(DWORD device, int motor);
BOOL WINAPI PmacPhasedMotor(DWORD device, int motor);
void WINAPI PmacRenumberFilesA(DWORD device, int number, LPCSTR ini_file);
BOOL WINAPI PmacSetCriticalIVars(DWORD device);
BOOL WINAPI PmacSetLanguage(DWORD device, LPCSTR locale);
void WINAPI PmacSetWindow(DWORD device, HWND window);
BOOL WINAPI PmacSockIsInvalid(DWORD device);
BOOL WINAPI PmacSockIsMultiHost(DWORD device);
BOOL WINAPI RestoreLinkList(LPCSTR firmware);
BOOL WINAPI SetLanguageModule(LPCSTR locale, HANDLE process, HANDLE *module);
BOOL WINAPI StoreUSResponse(DWORD device, LPCSTR text, DWORD size);
BOOL WINAPI USReadReady(DWORD device);
DWORD WINAPI UltraLightAnalyze(DWORD device, ULTRALIGHT_INFO *info);
BOOL WINAPI getBitValue(LPCSTR text, int bit);
LONG WINAPI hex_long2(LPCSTR text, int length);
LPSTR WINAPI szLoadStringA(HANDLE module, int id);
LONG WINAPI whyCSNotMoving(DWORD device, UINT system);
LPCSTR WINAPI whyCSNotMovingString(LONG reason);
LPCSTR WINAPI whyCSNotMovingStringTURBO(LONG reason);
LONG WINAPI whyCSNotMovingTURBO(DWORD device, UINT system);
LONG WINAPI whyMotorNotMoving(DWORD device, UINT motor);
LPCSTR WINAPI whyMotorNotMovingString(LONG reason);
LPCSTR WINAPI whyMotorNotMovingStringTURBO(LONG reason);

#ifdef __cplusplus
}
#endif

/* The names without a letter mean the functions of bytes, or with UNICODE those of 16-bit characters. */
#ifdef UNICODE
#define PmacGetResponse PmacGetResponseW
#define PmacGetResponseEx PmacGetResponseExW
#define PmacGetControlResponse PmacGetControlResponseW
#define PmacGetControlResponseEx PmacGetControlResponseExW
#define PmacSendLine PmacSendLineW
#define PmacGetLine PmacGetLineW
#define PmacGetLineEx PmacGetLineExW
#else
#define PmacGetResponse PmacGetResponseA
#define PmacGetResponseEx PmacGetResponseExA
#define PmacGetControlResponse PmacGetControlResponseA
#define PmacGetControlResponseEx PmacGetControlResponseExA
#define PmacSendLine PmacSendLineA
#define PmacGetLine PmacGetLineA
#define PmacGetLineEx PmacGetLineExA
#endif
#define PmacSendChar PmacSendCharA
#define PmacSendCommand PmacSendCommandA
#define PmacGetBuffer PmacGetBufferA
#define PmacGetErrorStr PmacGetErrorStrA
#define PmacGetRomDate PmacGetRomDateA
#define PmacGetRomVersion PmacGetRomVersionA
#define PmacGetVariableStr PmacGetVariableStrA
#define PmacDownload PmacDownloadA
#define PmacDPRAsciiStrToRot PmacDPRAsciiStrToRotA

#endif
