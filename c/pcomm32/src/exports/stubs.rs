//! The names that this library exports and does not have: a program that finds all names loads, and learns from a call
//! that the function fails. `docs/pcomm32.md` tells why each is missing.

use std::ffi::c_char;

use super::{BOOL, DWORD, Pointer, Words, int};
use crate::border::{stubs, stubs_without_device};

stubs! {
    () = () => {
        DoAGantryParabolic(DWORD, DWORD, DWORD);
        DoAGantryPositionLoopStep(DWORD, DWORD, DWORD);
        DownloadGantryAutoTuningPLC(DWORD, DWORD, DWORD, BOOL, BOOL, f32, int);
        PmacAbortDownload(DWORD);
        PmacClearGather(DWORD);
        PmacClearGatherData(DWORD);
        PmacClearRTGather(DWORD);
        PmacDPRGetCompensationPos(DWORD, int, f64, Pointer);
        PmacDPRGetGlobalStatus(DWORD, Pointer);
        PmacDPRGetGlobalStatusTurbo(DWORD, Pointer);
        PmacDPRGetMasterPos(DWORD, int, f64, Pointer);
        PmacDPRPCITest(DWORD);
        PmacDPRRealTimeSetMotor(DWORD, int);
        PmacDPRResetDWordBit(DWORD, DWORD, DWORD);
        PmacDPRRotBufClr(DWORD, DWORD);
        PmacDPRSetDWord(DWORD, DWORD, DWORD);
        PmacDPRSetDWordBit(DWORD, DWORD, DWORD);
        PmacDPRSetDWordMask(DWORD, DWORD, DWORD, BOOL);
        PmacDPRSetFOEnableBit(DWORD, int, int);
        PmacDPRSetFOValue(DWORD, int, int);
        PmacDPRSetFloat(DWORD, DWORD, f64);
        PmacDPRSetHoldBit(DWORD, int, int);
        PmacDPRSetHomeBit(DWORD, int, int);
        PmacDPRSetJogNegBit(DWORD, int, int);
        PmacDPRSetJogPosBit(DWORD, int, int);
        PmacDPRSetJogReturnBit(DWORD, int, int);
        PmacDPRSetMotors(DWORD, DWORD);
        PmacDPRSetRequestBit(DWORD, int, int);
        PmacDPRSetRunBit(DWORD, int, int);
        PmacDPRSetStepBit(DWORD, int, int);
        PmacDPRSetStopBit(DWORD, int, int);
        PmacDPRSetWord(DWORD, DWORD, u16);
        PmacDownloadFile(DWORD, Pointer);
        PmacRenumberFilesA(DWORD, int, Pointer);
        PmacSetIVariableDouble(DWORD, DWORD, f64);
        PmacSetIVariableLong(DWORD, DWORD, int);
        PmacSetVariable(DWORD, c_char, DWORD, i16);
        PmacSetVariableDouble(DWORD, c_char, DWORD, f64);
        PmacSetVariableLong(DWORD, c_char, DWORD, int);
        PmacSetWindow(DWORD, Pointer);
    }
    BOOL = 0 => {
        ChangeGet(DWORD, Pointer, DWORD);
        ChangeReadReady(DWORD);
        ChangeStore(DWORD, Pointer);
        GetUSResponse(DWORD, Pointer, DWORD);
        MACROSetIVariableString(DWORD, DWORD, DWORD, Pointer);
        MACROUploadConfig(DWORD, Pointer, Pointer);
        PmacAddRTGather(DWORD, DWORD);
        PmacAmpEnabled(DWORD, int);
        PmacAmpFault(DWORD, int);
        PmacDPRAmpEnabled(DWORD, int);
        PmacDPRAmpFault(DWORD, int);
        PmacDPRAvailable(DWORD);
        PmacDPRBackGroundVar(DWORD, BOOL);
        PmacDPRBackground(DWORD, int);
        PmacDPRBackgroundEx(DWORD, int, DWORD, DWORD);
        PmacDPRControlPanel(DWORD, int);
        PmacDPRDWordBitSet(DWORD, DWORD, DWORD);
        PmacDPRDataBlock(DWORD, int);
        PmacDPRFatalFError(DWORD, int);
        PmacDPRHandwheelEnabled(DWORD, int);
        PmacDPRHomeComplete(DWORD, int);
        PmacDPRInposition(DWORD, int);
        PmacDPRMotorEnabled(DWORD, int);
        PmacDPROnNegativeLimit(DWORD, int);
        PmacDPROnPositionLimit(DWORD, int);
        PmacDPROnPositiveLimit(DWORD, int);
        PmacDPROpenLoop(DWORD, int);
        PmacDPRPhasedMotor(DWORD, int);
        PmacDPRRealTime(DWORD, DWORD, int);
        PmacDPRRealTimeEx(DWORD, int, DWORD, int);
        PmacDPRRotBufOpen(DWORD);
        PmacDPRSysInposition(DWORD, int);
        PmacDPRUpdateRealTime(DWORD);
        PmacDPRVarBufChange(DWORD, int, int, Pointer);
        PmacDPRVarBufChangeEx(DWORD, int, int, Pointer, Pointer);
        PmacDPRVarBufRead(DWORD, int, int, Pointer);
        PmacDPRVarBufReadEx(DWORD, int, Pointer);
        PmacDPRVarBufRemove(DWORD, int);
        PmacDPRWarnFError(DWORD, int);
        PmacDoChecksums(DWORD, BOOL);
        PmacFatalFError(DWORD, int);
        PmacGetDpramAvailable(DWORD);
        PmacGetGather(DWORD, DWORD, Pointer, DWORD);
        PmacGetGatherEnable(DWORD, DWORD);
        PmacGetGatherPoint(DWORD, DWORD, DWORD, Pointer);
        PmacGetGatherSamples(DWORD, DWORD, Pointer, Pointer, DWORD);
        PmacGetMotorStatus(DWORD, DWORD, Pointer);
        PmacGetVariableStrA(DWORD, c_char, Pointer, DWORD);
        PmacINTRFuncCallInit(DWORD, Pointer, DWORD, DWORD);
        PmacINTRSetupMask(DWORD, DWORD);
        PmacINTRTerminate(DWORD);
        PmacINTRWndMsgInit(DWORD, Pointer, DWORD, DWORD);
        PmacInBootStrapMode(DWORD);
        PmacInitGather(DWORD, DWORD, f64);
        PmacInitRTGather(DWORD);
        PmacOnNegativeLimit(DWORD, int);
        PmacOnPositiveLimit(DWORD, int);
        PmacPhasedMotor(DWORD, int);
        PmacSERCheckSendLineA(DWORD, Pointer, Pointer);
        PmacSetCriticalIVars(DWORD);
        PmacSetCurrentGather(DWORD, DWORD, BOOL);
        PmacSetGather(DWORD, DWORD, Pointer, BOOL);
        PmacSetGatherEnable(DWORD, DWORD, BOOL);
        PmacSetLanguage(DWORD, Pointer);
        PmacSetQuickGather(DWORD, DWORD, BOOL);
        PmacSetQuickGatherEx(DWORD, Pointer, BOOL);
        PmacSetQuickGatherWithDirectCurrent(DWORD, DWORD, BOOL);
        PmacSetQuickGatherWithDirectCurrentEx(DWORD, Pointer, BOOL);
        PmacSockIsInvalid(DWORD);
        PmacSockIsMultiHost(DWORD);
        ShutdownPmacDevice(DWORD, BOOL);
        StoreUSResponse(DWORD, Pointer, DWORD);
        USReadReady(DWORD);
        bPMACIsTurbo(DWORD);
    }
    DWORD = 0 => {
        MapLocAndEnumFromDeviceNum(DWORD, Pointer, Pointer);
        PmacDPRGetDWord(DWORD, DWORD);
        PmacDPRGetDWordMask(DWORD, DWORD, DWORD);
        PmacDPRGetMoveTime(DWORD, int);
        PmacDPRGetPrevDAC(DWORD, int);
        PmacDPRGetVBGServoTimer(DWORD);
        PmacGetGatherPeriod(DWORD);
        PmacGetNumGatherSamples(DWORD);
        PmacGetNumGatherSources(DWORD);
        PmacSERGetBaudrate(DWORD);
        PmacSERGetPort(DWORD);
        PmacSetGatherPeriod(DWORD, DWORD);
        UltraLightAnalyze(DWORD, Pointer);
    }
    Pointer = std::ptr::null() => {
        MACROGetIVariableString(DWORD, DWORD, DWORD, Pointer);
        PmacCollectGatherData(DWORD, Pointer, Pointer);
        PmacCollectRTGatherData(DWORD, Pointer);
        PmacDPRGetMem(DWORD, DWORD, usize, Pointer);
        PmacDPRSetMem(DWORD, DWORD, usize, Pointer);
        PmacGetRomDateA(DWORD, Pointer, int);
        PmacGetRomVersionA(DWORD, Pointer, int);
        PmacGetUserHandle(DWORD);
    }
    Words<12> = Words([0; 12]) => {
        PmacDPRMotorRealtimeStructTurbo(DWORD, int);
    }
    Words<15> = Words([0; 15]) => {
        PmacDPRMotorRealtimeStruct(DWORD, int);
    }
    Words<1> = Words([0; 1]) => {
        PmacDPRMotorServoStatusTurbo(DWORD, int);
        PmacDPRMotorStatusTurbo(DWORD, int);
    }
    Words<2> = Words([0; 2]) => {
        PmacDPRGlobalStatus(DWORD);
    }
    f32 = 0.0 => {
        PmacDPRGetFloat(DWORD, DWORD);
    }
    f64 = 0.0 => {
        PmacDPRCommanded(DWORD, int, c_char);
        PmacDPRFollowError(DWORD, int, f64);
        PmacDPRGetBiasPos(DWORD, int, f64);
        PmacDPRGetCommandedPos(DWORD, int, f64);
        PmacDPRGetFeedRateMode(DWORD, int, Pointer);
        PmacDPRGetTargetPos(DWORD, int, f64);
        PmacDPRGetVel(DWORD, int, f64);
        PmacDPRPosition(DWORD, int, f64);
        PmacDPRVectorVelocity(DWORD, int, Pointer, Pointer);
        PmacDPRVelocity(DWORD, int, f64);
        PmacFollowError(DWORD, int, f64);
        PmacGetGatherSampleTime(DWORD);
        PmacGetIVariableDouble(DWORD, DWORD, f64);
        PmacGetVariableDouble(DWORD, c_char, DWORD, f64);
        PmacNetActualPosition(DWORD, int, f64);
        PmacSetGatherSampleTime(DWORD, f64);
    }
    i16 = -1 => {
        PmacDPRAsciiStrToRotA(DWORD, Pointer, u16);
        PmacDPRAsciiStrToRotEx(DWORD, Pointer, u16, BOOL);
        PmacDPRRotBuf(DWORD, BOOL);
        PmacDPRRotBufChange(DWORD, u16, u16);
        PmacDPRRotBufInit(DWORD, u16);
        PmacDPRRotBufRemove(DWORD, u16);
        PmacDPRrotput(DWORD, int, Pointer, int);
    }
    i16 = 0 => {
        PmacGetVariable(DWORD, c_char, DWORD, i16);
    }
    int = -1 => {
        MACROGetIVariableLong(DWORD, DWORD, DWORD, int);
        PmacDPRAddressRange(DWORD, BOOL, BOOL);
        PmacDPRBufLast(DWORD);
        PmacDPRGetFOEnableBit(DWORD, int);
        PmacDPRGetFOValue(DWORD, int);
        PmacDPRGetHoldBit(DWORD, int);
        PmacDPRGetHomeBit(DWORD, int);
        PmacDPRGetJogNegBit(DWORD, int);
        PmacDPRGetJogPosBit(DWORD, int);
        PmacDPRGetJogReturnBit(DWORD, int);
        PmacDPRGetMotorMotion(DWORD, int);
        PmacDPRGetProgramMode(DWORD, int);
        PmacDPRGetRequestBit(DWORD, int);
        PmacDPRGetRunBit(DWORD, int);
        PmacDPRGetServoTimer(DWORD);
        PmacDPRGetStepBit(DWORD, int);
        PmacDPRGetStopBit(DWORD, int);
        PmacDPRPe(DWORD, int);
        PmacDPRProgRemaining(DWORD, int);
        PmacDPRTest(DWORD, Pointer, Pointer);
        PmacDPRTimeRemInMove(DWORD, int);
        PmacDPRTimeRemInTATS(DWORD, int);
        PmacDPRWriteBuffer(DWORD, int, Pointer);
        PmacDPRWriteBufferEx(DWORD, int, Pointer, Pointer, Pointer);
        PmacGetEnumeration(DWORD);
        PmacGetIVariableLong(DWORD, DWORD, int);
        PmacGetPmacType(DWORD);
        PmacGetVariableLong(DWORD, c_char, DWORD, int);
        PmacSERCheckGetLineA(DWORD, Pointer, DWORD, Pointer);
        PmacSERCheckResponseA(DWORD, Pointer, DWORD, Pointer);
        PmacSERDoChecksums(DWORD, DWORD);
        PmacSerCheckAllWentWell(DWORD, int, Pointer, c_char);
        PmacStartGather(DWORD);
        PmacStopGather(DWORD);
        whyCSNotMoving(DWORD, DWORD);
        whyCSNotMovingTURBO(DWORD, DWORD);
        whyMotorNotMoving(DWORD, DWORD);
    }
    int = 0 => {
        PmacAddDownloadFileA(DWORD, Pointer, Pointer, Pointer);
        PmacDPRVarBufInit(DWORD, int, Pointer);
        PmacDPRVarBufInitEx(DWORD, int, Pointer, Pointer);
        PmacDownloadA(DWORD, Pointer, Pointer, Pointer, Pointer, BOOL, BOOL, BOOL, BOOL);
        PmacGetLocation(DWORD);
        PmacMultiDownloadA(DWORD, Pointer, Pointer, Pointer, Pointer, BOOL, BOOL, BOOL, BOOL);
        PmacRemoveDownloadFileA(DWORD, Pointer, Pointer, Pointer);
        PmacThreadDownloadA(DWORD, Pointer, Pointer, Pointer, Pointer, BOOL, BOOL, BOOL, BOOL);
    }
    u16 = 0 => {
        PmacDPRGetWord(DWORD, DWORD);
        PmacGetPlcStatus(DWORD, Pointer);
        PmacIsAnyPLCRunning(DWORD);
    }
}

stubs_without_device! {
    () = () => {
        PmacAbortDPRTest();
        PmacLMH(Pointer);
        PmacSetMaxDownloadErrors(DWORD);
    }
    BOOL = 0 => {
        RestoreLinkList(Pointer);
        SetLanguageModule(Pointer, Pointer, Pointer);
        getBitValue(Pointer, int);
    }
    DWORD = 0 => {
        MapDeviceNumToEnumAndLocation(int, DWORD);
    }
    Pointer = std::ptr::null() => {
        szLoadStringA(Pointer, int);
        whyCSNotMovingString(int);
        whyCSNotMovingStringTURBO(int);
        whyMotorNotMovingString(int);
        whyMotorNotMovingStringTURBO(int);
    }
    f64 = 0.0 => {
        PmacDPRFloat(Pointer, f64);
        PmacDPRLFixed(Pointer, f64);
    }
    int = -1 => {
        hex_long2(Pointer, int);
    }
    int = 0 => {
        PmacDownloadProgress(BOOL, BOOL, Pointer, DWORD, Pointer, BOOL, BOOL, BOOL, BOOL);
    }
}
