//! The names that this library exports and does not have: a program that finds all names loads, and learns from a call
//! that the function fails. `docs/pcomm32.md` tells why each is missing.

use std::ffi::c_char;

use super::{BOOL, DWORD, Pointer, int};
use crate::border::{stubs, stubs_without_device};

stubs! {
    () = () => {
        DoAGantryParabolic(DWORD, DWORD, DWORD);
        DoAGantryPositionLoopStep(DWORD, DWORD, DWORD);
        DownloadGantryAutoTuningPLC(DWORD, DWORD, DWORD, BOOL, BOOL, f32, int);
        PmacClearGather(DWORD);
        PmacClearGatherData(DWORD);
        PmacClearRTGather(DWORD);
        PmacDPRPCITest(DWORD);
        PmacDPRSetFOEnableBit(DWORD, int, int);
        PmacDPRSetFOValue(DWORD, int, int);
        PmacDPRSetHoldBit(DWORD, int, int);
        PmacDPRSetHomeBit(DWORD, int, int);
        PmacDPRSetJogNegBit(DWORD, int, int);
        PmacDPRSetJogPosBit(DWORD, int, int);
        PmacDPRSetJogReturnBit(DWORD, int, int);
        PmacDPRSetRequestBit(DWORD, int, int);
        PmacDPRSetRunBit(DWORD, int, int);
        PmacDPRSetStepBit(DWORD, int, int);
        PmacDPRSetStopBit(DWORD, int, int);
        PmacRenumberFilesA(DWORD, int, Pointer);
        PmacSetWindow(DWORD, Pointer);
    }
    BOOL = 0 => {
        ChangeGet(DWORD, Pointer, DWORD);
        ChangeReadReady(DWORD);
        ChangeStore(DWORD, Pointer);
        MACROSetIVariableString(DWORD, DWORD, DWORD, Pointer);
        MACROUploadConfig(DWORD, Pointer, Pointer);
        PmacAddRTGather(DWORD, DWORD);
        PmacDPRControlPanel(DWORD, int);
        PmacDPRRotBufOpen(DWORD);
        PmacDPRVarBufChange(DWORD, int, int, Pointer);
        PmacDPRVarBufChangeEx(DWORD, int, int, Pointer, Pointer);
        PmacDPRVarBufRead(DWORD, int, int, Pointer);
        PmacDPRVarBufReadEx(DWORD, int, Pointer);
        PmacDPRVarBufRemove(DWORD, int);
        PmacDoChecksums(DWORD, BOOL);
        PmacGetGather(DWORD, DWORD, Pointer, DWORD);
        PmacGetGatherEnable(DWORD, DWORD);
        PmacGetGatherPoint(DWORD, DWORD, DWORD, Pointer);
        PmacGetGatherSamples(DWORD, DWORD, Pointer, Pointer, DWORD);
        PmacGetMotorStatus(DWORD, DWORD, Pointer);
        PmacINTRSetupMask(DWORD, DWORD);
        PmacINTRWndMsgInit(DWORD, Pointer, DWORD, DWORD);
        PmacInitGather(DWORD, DWORD, f64);
        PmacInitRTGather(DWORD);
        PmacSERCheckSendLineA(DWORD, Pointer, Pointer);
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
    }
    DWORD = 0 => {
        MapLocAndEnumFromDeviceNum(DWORD, Pointer, Pointer);
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
        PmacGetUserHandle(DWORD);
    }
    f64 = 0.0 => {
        PmacDPRGetFeedRateMode(DWORD, int, Pointer);
        PmacGetGatherSampleTime(DWORD);
        PmacNetActualPosition(DWORD, int, f64);
        PmacSetGatherSampleTime(DWORD, f64);
    }
    int = -1 => {
        MACROGetIVariableLong(DWORD, DWORD, DWORD, int);
        PmacDPRAddressRange(DWORD, BOOL, BOOL);
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
        PmacDPRGetStepBit(DWORD, int);
        PmacDPRGetStopBit(DWORD, int);
        PmacDPRTest(DWORD, Pointer, Pointer);
        PmacDPRWriteBuffer(DWORD, int, Pointer);
        PmacDPRWriteBufferEx(DWORD, int, Pointer, Pointer, Pointer);
        PmacGetEnumeration(DWORD);
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
        PmacGetLocation(DWORD);
        PmacMultiDownloadA(DWORD, Pointer, Pointer, Pointer, Pointer, BOOL, BOOL, BOOL, BOOL);
        PmacRemoveDownloadFileA(DWORD, Pointer, Pointer, Pointer);
    }
    u16 = 0 => {
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
    int = -1 => {
        hex_long2(Pointer, int);
    }
    int = 0 => {
        PmacDownloadProgress(BOOL, BOOL, Pointer, DWORD, Pointer, BOOL, BOOL, BOOL, BOOL);
    }
}
