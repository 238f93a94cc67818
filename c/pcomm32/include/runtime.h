/* A variable for each of PComm32's functions, as programs with a loader use them: DeviceOpen for OpenPmacDevice.
 * runtime.c defines and fills them; a program may bring the vendor's runtime.cpp in its place. */
#ifndef PCOMM32_RUNTIME_H
#define PCOMM32_RUNTIME_H

#include "pmacu.h"

#define DRIVERNAME TEXT("PComm32W.dll")

/* LINK(type of the variable, variable, function) for each function that the vendor's loader needs. */
#define PCOMM32_LINKS(LINK) \
    LINK(OPENPMACDEVICE, DeviceOpen, OpenPmacDevice) \
    LINK(CLOSEPMACDEVICE, DeviceClose, ClosePmacDevice) \
    LINK(SELECTPMACDEVICE, DeviceSelect, PmacSelect) \
    LINK(CONFIGURE, DeviceConfigure, PmacConfigure) \
    LINK(LOCKPMAC, DeviceLock, LockPmac) \
    LINK(RELEASEPMAC, DeviceRelease, ReleasePmac) \
    LINK(NUMBEROFDEVICES, DeviceNumberOfDevices, DrvNumberOfDevices) \
    LINK(MAPDEVICENUMTOENUANDLOC, DeviceMapDeviceNumToEnumAndLocation, MapDeviceNumToEnumAndLocation) \
    LINK(MAPLOCANDENUMFROMDEVICENUM, DeviceMapLocAndEnumFromDeviceNum, MapLocAndEnumFromDeviceNum) \
    LINK(DEVICESHUTDOWNPMAC, DeviceShutdownPmac, ShutdownPmacDevice) \
    LINK(GETRESPONSEA, DeviceGetResponse, PmacGetResponseA) \
    LINK(GETRESPONSEEXA, DeviceGetResponseEx, PmacGetResponseExA) \
    LINK(SENDLINEA, DeviceSendLine, PmacSendLineA) \
    LINK(SETASCIICOMM, DeviceSetAsciiComm, PmacSetAsciiComm) \
    LINK(FLUSH, DeviceFlush, PmacFlush) \
    LINK(GETERRORSTRA, DeviceGetErrorStr, PmacGetErrorStrA) \
    LINK(GETLINEA, DeviceGetLine, PmacGetLineA) \
    LINK(GETCONTROLRESPONSEA, DeviceGetControlResponse, PmacGetControlResponseA) \
    LINK(GETERROR, DeviceGetError, PmacGetError) \
    LINK(READREADY, DeviceReadReady, PmacReadReady) \
    LINK(GETBUFFERA, DeviceGetBuffer, PmacGetBufferA) \
    LINK(FOLLOWERROR, DeviceFollowError, PmacFollowError) \
    LINK(GETASCIICOMM, DeviceGetAsciiComm, PmacGetAsciiComm) \
    LINK(GETCONTROLRESPONSEEXA, DeviceGetControlResponseEx, PmacGetControlResponseExA) \
    LINK(GETCONTROLRESPONSEEXW, DeviceGetControlResponseExW, PmacGetControlResponseExW) \
    LINK(GETCONTROLRESPONSEW, DeviceGetControlResponseW, PmacGetControlResponseW) \
    LINK(GETLINEEXA, DeviceGetLineEx, PmacGetLineExA) \
    LINK(GETLINEEXW, DeviceGetLineExW, PmacGetLineExW) \
    LINK(GETLINEW, DeviceGetLineW, PmacGetLineW) \
    LINK(GETRESPONSEEXW, DeviceGetResponseExW, PmacGetResponseExW) \
    LINK(GETRESPONSEW, DeviceGetResponseW, PmacGetResponseW) \
    LINK(SENDCHARA, DeviceSendChar, PmacSendCharA) \
    LINK(SENDLINEW, DeviceSendLineW, PmacSendLineW) \
    LINK(GETVARIABLEDOUBLE, DeviceGetVariableDouble, PmacGetVariableDouble) \
    LINK(SETVARIABLE, DeviceSetVariable, PmacSetVariable) \
    LINK(SETVARIABLEDOUBLE, DeviceSetVariableDouble, PmacSetVariableDouble) \
    LINK(SETIVARIABLEDOUBLE, DeviceSetIVariableDouble, PmacSetIVariableDouble) \
    LINK(GETVARIABLELONG, DeviceGetVariableLong, PmacGetVariableLong) \
    LINK(GETIVARIABLEDOUBLE, DeviceGetIVariableDouble, PmacGetIVariableDouble) \
    LINK(GETIVARIABLELONG, DeviceGetIVariableLong, PmacGetIVariableLong) \
    LINK(GETVARIABLESTRA, DeviceGetVariableStr, PmacGetVariableStrA) \
    LINK(SETIVARIABLELONG, DeviceSetIVariableLong, PmacSetIVariableLong) \
    LINK(SETVARIABLELONG, DeviceSetVariableLong, PmacSetVariableLong) \
    LINK(GETROMDATEA, DeviceGetRomDate, PmacGetRomDateA) \
    LINK(GETROMVERSIONA, DeviceGetRomVersion, PmacGetRomVersionA) \
    LINK(GETPMACTYPE, DeviceGetPmacType, PmacGetPmacType) \
    LINK(DPRAVAILABLE, DeviceDPRAvailable, PmacGetDpramAvailable) \
    LINK(GETPLCSTATUS, DeviceGetPlcStatus, PmacGetPlcStatus) \
    LINK(ISANYPLCRUNNING, DeviceIsAnyPLCRunning, PmacIsAnyPLCRunning) \
    LINK(PMACISTURBO, DevicePmacIsTurbo, bPMACIsTurbo) \
    LINK(DOWNLOADA, DeviceDownload, PmacDownloadA) \
    LINK(DOWNLOAD_SHOWPROGRESS, DeviceDownloadProgress, PmacDownloadProgress) \
    LINK(DOWNLOADGANTRYAUTOTUNINGPLC, DeviceDownloadGantryAutotuningPLC, DownloadGantryAutoTuningPLC) \
    LINK(ABORTDOWNLOAD, DeviceAbortDownload, PmacAbortDownload) \
    LINK(ADDDOWNLOADFILEA, DeviceAddDownloadFile, PmacAddDownloadFileA) \
    LINK(MULTIDOWNLOADA, DeviceMultiDownload, PmacMultiDownloadA) \
    LINK(REMOVEDOWNLOADFILEA, DeviceRemoveDownloadFile, PmacRemoveDownloadFileA) \
    LINK(SETMAXDOWNLOADERRORS, DeviceSetMaxDownloadErrors, PmacSetMaxDownloadErrors) \
    LINK(DOWNLOADTHREADA, DeviceDownloadThread, PmacThreadDownloadA) \
    LINK(PMACDPRGETMEM, DeviceDPRGetMem, PmacDPRGetMem) \
    LINK(DPRGETDWORD, DeviceDPRGetDWord, PmacDPRGetDWord) \
    LINK(DPRSETDWORD, DeviceDPRSetDWord, PmacDPRSetDWord) \
    LINK(PMACDPRSETMEM, DeviceDPRSetMem, PmacDPRSetMem) \
    LINK(DPRGETFLOAT, DeviceDPRGetFloat, PmacDPRGetFloat) \
    LINK(DPRSETFLOAT, DeviceDPRSetFloat, PmacDPRSetFloat) \
    LINK(DPRGETWORD, DeviceDPRGetWord, PmacDPRGetWord) \
    LINK(DPRSETWORD, DeviceDPRSetWord, PmacDPRSetWord) \
    LINK(DPRFLOAT, DeviceDPRFloat, PmacDPRFloat) \
    LINK(DPRLFIXED, DeviceDPRLFixed, PmacDPRLFixed) \
    LINK(DPRADDRESSRANGE, DeviceDPRAddressRange, PmacDPRAddressRange) \
    LINK(DPRDWORDBITSET, DeviceDPRDWordBitSet, PmacDPRDWordBitSet) \
    LINK(DPRGETDWORDMASK, DeviceDPRGetDWordMask, PmacDPRGetDWordMask) \
    LINK(DPRRESETDWORDBIT, DeviceDPRResetDWordBit, PmacDPRResetDWordBit) \
    LINK(DPRSETDWORDBIT, DeviceDPRSetDWordBit, PmacDPRSetDWordBit) \
    LINK(DPRSETDWORDMASK, DeviceDPRSetDWordMask, PmacDPRSetDWordMask) \
    LINK(DPRBACKGROUND, DeviceDPRBackground, PmacDPRBackground) \
    LINK(DPRGETCOMMANDEDPOS, DeviceDPRGetCommandedPos, PmacDPRGetCommandedPos) \
    LINK(DPRPOSITION, DeviceDPRPosition, PmacDPRPosition) \
    LINK(DPRREALTIME, DeviceDPRRealTime, PmacDPRRealTime) \
    LINK(DPRREALTIMEEX, DeviceDPRRealTimeEx, PmacDPRRealTimeEx) \
    LINK(DPRSETMOTORS, DeviceDPRSetMotors, PmacDPRSetMotors) \
    LINK(DPRUPDATEREALTIME, DeviceDPRUpdateRealtime, PmacDPRUpdateRealTime) \
    LINK(DPRGETVEL, DeviceDPRGetVel, PmacDPRGetVel) \
    LINK(DPRBACKGROUNDEX, DeviceDPRBackgroundEx, PmacDPRBackgroundEx) \
    LINK(DPRCOMMANDED, DeviceDPRCommanded, PmacDPRCommanded) \
    LINK(DPRGETBIASPOS, DeviceDPRGetBiasPos, PmacDPRGetBiasPos) \
    LINK(DPRGETTARGETPOS, DeviceDPRGetTargetPos, PmacDPRGetTargetPos) \
    LINK(DPRONNEGATIVELIMIT, DeviceDPROnNegativeLimit, PmacDPROnNegativeLimit) \
    LINK(DPRONPOSITIVELIMIT, DeviceDPROnPositiveLimit, PmacDPROnPositiveLimit) \
    LINK(DPRDATABLOCK, DeviceDPRDataBlock, PmacDPRDataBlock) \
    LINK(DPRFOLLOWERROR, DeviceDPRFollowError, PmacDPRFollowError) \
    LINK(DPRGETCOMPENSATIONPOS, DeviceDPRGetCompensationPos, PmacDPRGetCompensationPos) \
    LINK(DPRGETFEEDRATEMODE, DeviceDPRGetFeedRateMode, PmacDPRGetFeedRateMode) \
    LINK(DPRGETMASTERPOS, DeviceDPRGetMasterPos, PmacDPRGetMasterPos) \
    LINK(DPRGETMOTORMOTION, DeviceDPRGetMotorMotion, PmacDPRGetMotorMotion) \
    LINK(DPRGETMOVETIME, DeviceDPRGetMoveTime, PmacDPRGetMoveTime) \
    LINK(DPRGETPREVDAC, DeviceDPRGetPrevDAC, PmacDPRGetPrevDAC) \
    LINK(DPRGETPROGRAMMODE, DeviceDPRGetProgramMode, PmacDPRGetProgramMode) \
    LINK(DPRGETSERVOTIMER, DeviceDPRGetServoTimer, PmacDPRGetServoTimer) \
    LINK(DPRGLOBALSTATUS, DeviceDPRGlobalStatus, PmacDPRGlobalStatus) \
    LINK(DPRHANDWHEELENABLED, DeviceDPRHandwheelEnabled, PmacDPRHandwheelEnabled) \
    LINK(DPRMOTORENABLED, DeviceDPRMotorEnabled, PmacDPRMotorEnabled) \
    LINK(DPRMOTORREALTIMESTRUCT, DeviceDPRMotorRealtimeStruct, PmacDPRMotorRealtimeStruct) \
    LINK(DPRMOTORREALTIMESTRUCTTURBO, DeviceDPRMotorRealtimeStructTurbo, PmacDPRMotorRealtimeStructTurbo) \
    LINK(DPRMOTORSERVOSTATUSTURBO, DeviceDPRMotorServoStatusTurbo, PmacDPRMotorServoStatusTurbo) \
    LINK(DPRMOTORSTATUSTURBO, DeviceDPRMotorStatusTurbo, PmacDPRMotorStatusTurbo) \
    LINK(DPROPENLOOP, DeviceDPROpenLoop, PmacDPROpenLoop) \
    LINK(PMACDPRPCITEST, DeviceDPRPCITest, PmacDPRPCITest) \
    LINK(DPRPE, DeviceDPRPe, PmacDPRPe) \
    LINK(DPRPHASEDMOTOR, DeviceDPRPhasedMotor, PmacDPRPhasedMotor) \
    LINK(DPRPROGREMAINING, DeviceDPRProgRemaining, PmacDPRProgRemaining) \
    LINK(DPRREALTIMESETMOTOR, DeviceDPRRealTimeSetMotor, PmacDPRRealTimeSetMotor) \
    LINK(DPRSYSINPOSITION, DeviceDPRSysInposition, PmacDPRSysInposition) \
    LINK(TESTDPRAM, DeviceTestDPRAM, PmacDPRTest) \
    LINK(DPRTIMEREMINMOVE, DeviceDPRTimeRemainingInMove, PmacDPRTimeRemInMove) \
    LINK(DPRTIMEREMINTATS, DeviceTimeRemInTATS, PmacDPRTimeRemInTATS) \
    LINK(DPRVELOCITY, DeviceDPRVelocity, PmacDPRVelocity) \
    LINK(DPRNETACTUALPOSITION, DeviceDPRNetActualPosition, PmacNetActualPosition) \
    LINK(DPRCONTROLPANEL, DeviceDPRControlPanel, PmacDPRControlPanel) \
    LINK(DPRGETFOENABLEBIT, DeviceDPRGetFOEnableBit, PmacDPRGetFOEnableBit) \
    LINK(DPRGETFOVALUE, DeviceDPRGetFOValue, PmacDPRGetFOValue) \
    LINK(DPRGETHOLDBIT, DeviceDPRGetHoldBit, PmacDPRGetHoldBit) \
    LINK(DPRGETHOMEBIT, DeviceDPRGetHomeBit, PmacDPRGetHomeBit) \
    LINK(DPRGETJOGNEGBIT, DeviceDPRGetJogNegBit, PmacDPRGetJogNegBit) \
    LINK(DPRGETJOGPOSBIT, DeviceDPRGetJogPosBit, PmacDPRGetJogPosBit) \
    LINK(DPRGETJOGRETURNBIT, DeviceDPRGetJogReturnBit, PmacDPRGetJogReturnBit) \
    LINK(DPRGETREQUESTBIT, DeviceDPRGetRequestBit, PmacDPRGetRequestBit) \
    LINK(DPRGETRUNBIT, DeviceDPRGetRunBit, PmacDPRGetRunBit) \
    LINK(DPRGETSTEPBIT, DeviceDPRGetStepBit, PmacDPRGetStepBit) \
    LINK(DPRGETSTOPBIT, DeviceDPRGetStopBit, PmacDPRGetStopBit) \
    LINK(DPRSETFOENABLEBIT, DeviceDPRSetFOEnableBit, PmacDPRSetFOEnableBit) \
    LINK(DPRSETFOVALUE, DeviceDPRSetFOValue, PmacDPRSetFOValue) \
    LINK(DPRSETHOLDBIT, DeviceDPRSetHoldBit, PmacDPRSetHoldBit) \
    LINK(DPRSETHOMEBIT, DeviceDPRSetHomeBit, PmacDPRSetHomeBit) \
    LINK(DPRSETJOGNEGBIT, DeviceDPRSetJogNegBit, PmacDPRSetJogNegBit) \
    LINK(DPRSETJOGPOSBIT, DeviceDPRSetJogPosBit, PmacDPRSetJogPosBit) \
    LINK(DPRSETJOGRETURNBIT, DeviceDPRSetJogReturnBit, PmacDPRSetJogReturnBit) \
    LINK(DPRSETREQUESTBIT, DeviceDPRSetRequestBit, PmacDPRSetRequestBit) \
    LINK(DPRSETRUNBIT, DeviceDPRSetRunBit, PmacDPRSetRunBit) \
    LINK(DPRSETSTEPBIT, DeviceDPRSetStepBit, PmacDPRSetStepBit) \
    LINK(DPRSETSTOPBIT, DeviceDPRSetStopBit, PmacDPRSetStopBit) \
    LINK(DPRASCIISTRTOROTA, DeviceDPRAsciiStrToRot, PmacDPRAsciiStrToRotA) \
    LINK(DPRBUFLAST, DeviceDPRBufLast, PmacDPRBufLast) \
    LINK(DPRROTBUFCHANGE, DeviceDPRRotBufChange, PmacDPRRotBufChange) \
    LINK(DPRROTBUFREMOVE, DeviceDPRRotBufRemove, PmacDPRRotBufRemove) \
    LINK(DPRASCIISTRTOROTEX, DeviceDPRAsciiStrToRotEx, PmacDPRAsciiStrToRotEx) \
    LINK(DPRROTBUF, DeviceDPRRotBuf, PmacDPRRotBuf) \
    LINK(DPRROTBUFCLEAR, DeviceDPRRotBufClear, PmacDPRRotBufClr) \
    LINK(DPRROTBUFINIT, DeviceDPRRotBufInit, PmacDPRRotBufInit) \
    LINK(DPRROTBUFOPEN, DeviceDPRRotBufOpen, PmacDPRRotBufOpen) \
    LINK(DPRROTBUFPUT, DeviceDPRRotBufPut, PmacDPRrotput) \
    LINK(DPRBACKGROUNDVAR, DeviceDPRBackGroundVar, PmacDPRBackGroundVar) \
    LINK(DPRGETVBGSERVOTIMER, DeviceDPRGetVBGServoTimer, PmacDPRGetVBGServoTimer) \
    LINK(DPRVARBUFCHANGE, DeviceDPRVarBufChange, PmacDPRVarBufChange) \
    LINK(DPRVARBUFCHANGEEX, DeviceDPRVarBufChangeEx, PmacDPRVarBufChangeEx) \
    LINK(DPRVARBUFINIT, DeviceDPRVarBufInit, PmacDPRVarBufInit) \
    LINK(DPRVARBUFINITEX, DeviceDPRVarBufInitEx, PmacDPRVarBufInitEx) \
    LINK(DPRVARBUFREAD, DeviceDPRVarBufRead, PmacDPRVarBufRead) \
    LINK(DPRVARBUFREADEX, DeviceDPRVarBufReadEx, PmacDPRVarBufReadEx) \
    LINK(DPRVARBUFREMOVE, DeviceDPRVarBufRemove, PmacDPRVarBufRemove) \
    LINK(DPRWRITEBUFFER, DeviceDPRWriteBuffer, PmacDPRWriteBuffer) \
    LINK(DPRWRITEBUFFEREX, DeviceDPRWriteBufferEx, PmacDPRWriteBufferEx) \
    LINK(ADDRTGATHER, DeviceAddRTGather, PmacAddRTGather) \
    LINK(CLEARGATHER, DeviceClearGather, PmacClearGather) \
    LINK(CLEARGATHERDATA, DeviceClearGatherData, PmacClearGatherData) \
    LINK(CLEARRTGATHER, DeviceClearRTGather, PmacClearRTGather) \
    LINK(COLLECTGATHERDATA, DeviceCollectGatherData, PmacCollectGatherData) \
    LINK(COLLECTRTGATHERDATA, DeviceCollectRTGatherData, PmacCollectRTGatherData) \
    LINK(GETGATHER, DeviceGetGather, PmacGetGather) \
    LINK(GETGATHERENABLE, DeviceGetGatherEnable, PmacGetGatherEnable) \
    LINK(GETGATHERPERIOD, DeviceGetGatherPeriod, PmacGetGatherPeriod) \
    LINK(GETGATHERPOINT, DeviceGetGatherPoint, PmacGetGatherPoint) \
    LINK(GETGATHERSAMPLETIME, DeviceGetGatherSampleTime, PmacGetGatherSampleTime) \
    LINK(GETGATHERSAMPLES, DeviceGetGatherSamples, PmacGetGatherSamples) \
    LINK(GETNUMGATHERSAMPLES, DeviceGetNumGatherSamples, PmacGetNumGatherSamples) \
    LINK(GETNUMGATHERSOURCES, DeviceGetNumGatherSources, PmacGetNumGatherSources) \
    LINK(INITGATHER, DeviceInitGather, PmacInitGather) \
    LINK(INITRTGATHER, DeviceInitRTGather, PmacInitRTGather) \
    LINK(SETCURRENTGATHER, DeviceSetCurrentGather, PmacSetCurrentGather) \
    LINK(SETGATHER, DeviceSetGather, PmacSetGather) \
    LINK(SETGATHERENABLE, DeviceSetGatherEnable, PmacSetGatherEnable) \
    LINK(SETGATHERPERIOD, DeviceSetGatherPeriod, PmacSetGatherPeriod) \
    LINK(SETGATHERSAMPLETIME, DeviceSetGatherSampleTime, PmacSetGatherSampleTime) \
    LINK(SETQUICKGATHER, DeviceSetQuickGather, PmacSetQuickGather) \
    LINK(SETQUICKGATHEREX, DeviceSetQuickGatherEx, PmacSetQuickGatherEx) \
    LINK(SETQGWITHDIRECTCUR, DeviceSetQGWithDirectCur, PmacSetQuickGatherWithDirectCurrent) \
    LINK(SETQGWITHDIRECTCUREX, DeviceSetQGWithDirectCurEx, PmacSetQuickGatherWithDirectCurrentEx) \
    LINK(STARTGATHER, DeviceStartGather, PmacStartGather) \
    LINK(STOPGATHER, DeviceStopGather, PmacStopGather) \
    LINK(INTRFUNCCALLINIT, DeviceINTRFuncCallInit, PmacINTRFuncCallInit) \
    LINK(INTRTERMINATE, DeviceINTRTerminate, PmacINTRTerminate) \
    LINK(INTRSETUPMASK, DeviceINTRSetupMask, PmacINTRSetupMask) \
    LINK(INTRWNDMSGINIT, DeviceINTRWndMsgInit, PmacINTRWndMsgInit) \
    LINK(SERCHECKGETLINEA, DeviceSERCheckGetLineA, PmacSERCheckGetLineA) \
    LINK(SERCHECKRESPONSEA, DeviceSERCheckResponseA, PmacSERCheckResponseA) \
    LINK(SERCHECKSENDLINEA, DeviceSERCheckSendLineA, PmacSERCheckSendLineA) \
    LINK(SERDOCHECKSUMS, DeviceSERDoChecksums, PmacSERDoChecksums) \
    LINK(SERGETBAUDRATE, DeviceSERGetBaudrate, PmacSERGetBaudrate) \
    LINK(SERGETPORT, DeviceSERGetPort, PmacSERGetPort) \
    LINK(SERCHECKALLWENTWELL, DeviceSERCheckAllWentWell, PmacSerCheckAllWentWell) \
    LINK(INBUFFEREDMODE, DeviceInBufferedMode, InBufferedMode) \
    LINK(CHANGEGET, DeviceChangeGet, ChangeGet) \
    LINK(CHANGEREADREADY, DeviceChangeReadReady, ChangeReadReady) \
    LINK(CHANGESTORE, DeviceChangeStore, ChangeStore) \
    LINK(DOWNLOADGANTRYPARABOLICPLC, DeviceDownloadGantryParabolicPLC, DoAGantryParabolic) \
    LINK(DOWNLOADGANTRYSTEPPLC, DeviceDownloadGantryStepPLC, DoAGantryPositionLoopStep) \
    LINK(GETUSRESPONSE, DeviceGetUSResponse, GetUSResponse) \
    LINK(MACROGETIVARIABLELONG, DeviceMACROGetIVariableLong, MACROGetIVariableLong) \
    LINK(MACROGETIVARIABLESTRING, DeviceMACROGetIVariableString, MACROGetIVariableString) \
    LINK(MACROSETIVARIABLESTRING, DeviceMACROSetIVariableString, MACROSetIVariableString) \
    LINK(MACROUPLOADCONFIG, DeviceMACROUploadConfig, MACROUploadConfig) \
    LINK(TESTDPRABORT, DeviceTestDPRAMAbort, PmacAbortDPRTest) \
    LINK(AMPENABLED, DeviceAmpEnabled, PmacAmpEnabled) \
    LINK(AMPFAULT, DeviceAmpFault, PmacAmpFault) \
    LINK(DOCHECKSUMS, DeviceDoChecksums, PmacDoChecksums) \
    LINK(FATALFERROR, DeviceFatalFError, PmacFatalFError) \
    LINK(GETENUMERATION, DeviceGetPmacEnumeration, PmacGetEnumeration) \
    LINK(GETLOCATION, DeviceGetPmacLocation, PmacGetLocation) \
    LINK(GETMOTORSTATUS, DeviceGetMotorStatus, PmacGetMotorStatus) \
    LINK(GETUSERHANDLE, DeviceGetUserHandle, PmacGetUserHandle) \
    LINK(INBOOTSTRAP, DeviceInBootStrapMode, PmacInBootStrapMode) \
    LINK(PMACLMH, DeviceLMH, PmacLMH) \
    LINK(ONNEGATIVELIMIT, DeviceOnNegativeLimit, PmacOnNegativeLimit) \
    LINK(ONPOSITIVELIMIT, DeviceOnPositiveLimit, PmacOnPositiveLimit) \
    LINK(PHASEDMOTOR, DevicePhasedMotor, PmacPhasedMotor) \
    LINK(RENUMBERFILESA, DeviceRenumberFiles, PmacRenumberFilesA) \
    LINK(SETCRITICALIVARS, DeviceSetCriticalIVars, PmacSetCriticalIVars) \
    LINK(PMACSETLANGUAGE, DeviceSetLanguage, PmacSetLanguage) \
    LINK(PMACSETWINDOW, DeviceSetWindow, PmacSetWindow) \
    LINK(PMACSOCKISINVALID, DeviceSockIsInvalid, PmacSockIsInvalid) \
    LINK(PMACSOCKISMULTIHOST, DeviceSockIsMultiHost, PmacSockIsMultiHost) \
    LINK(RESTORELINKLIST, DeviceRestoreLinkList, RestoreLinkList) \
    LINK(SETLANGUAGEMODULE, DeviceSetLanguageModule, SetLanguageModule) \
    LINK(STOREUSRESPONSE, DeviceStoreUSResponse, StoreUSResponse) \
    LINK(USREADREADY, DeviceUSReadReady, USReadReady) \
    LINK(ULTRALIGHTANALYZE, DeviceUltraLightAnalyze, UltraLightAnalyze) \
    LINK(GETBITVALUE, DeviceGetBitValue, getBitValue) \
    LINK(HEXLONG2, DeviceHexLong2, hex_long2) \
    LINK(SZLOADSTRINGA, DeviceLoadString, szLoadStringA) \
    LINK(WHYCSNOTMOVING, DeviceWhyCsNotMoving, whyCSNotMoving) \
    LINK(WHYCSNOTMOVINGSTRING, DeviceWhyCsNotMovingString, whyCSNotMovingString) \
    LINK(WHYCSNOTMOVINGSTRINGTURBO, DeviceWhyCsNotMovingStringTURBO, whyCSNotMovingStringTURBO) \
    LINK(WHYCSNOTMOVINGTURBO, DeviceWhyCsNotMovingTURBO, whyCSNotMovingTURBO) \
    LINK(WHYMOTORNOTMOVING, DeviceWhyMotorNotMoving, whyMotorNotMoving) \
    LINK(WHYMOTORNOTMOVINGSTRING, DeviceWhyMotorNotMovingString, whyMotorNotMovingString) \
    LINK(WHYMOTORNOTMOVINGSTRINGTURBO, DeviceWhyMotorNotMovingStringTURBO, whyMotorNotMovingStringTURBO)

#ifdef __cplusplus
#define PCOMM32_POINTER(function) decltype(&function)
extern "C" {
#else
#define PCOMM32_POINTER(function) __typeof__(&function)
#endif

#define PCOMM32_TYPE(type, variable, function) typedef PCOMM32_POINTER(function) type;
PCOMM32_LINKS(PCOMM32_TYPE)
#undef PCOMM32_TYPE
typedef CONFIGURE PMACCONFIGURE;
typedef WHYMOTORNOTMOVING WHYMOTORNOTMOVINGTURBO;

/* The file that defines the variables says NO_EXTERN before it includes this header. */
#ifdef NO_EXTERN
#define PCOMM32_VARIABLE(type, variable, function) type variable;
#else
#define PCOMM32_VARIABLE(type, variable, function) extern type variable;
#endif
PCOMM32_LINKS(PCOMM32_VARIABLE)
PCOMM32_VARIABLE(PMACCONFIGURE, DevicePmacConfigure, PmacConfigure)
PCOMM32_VARIABLE(WHYMOTORNOTMOVINGTURBO, DeviceWhyMotorNotMovingTURBO, whyMotorNotMoving)
#undef PCOMM32_VARIABLE

extern HINSTANCE hPmacLib;

/* Loads the library and fills the variables. NULL: there is no library, or it lacks a function. */
HINSTANCE OpenRuntimeLink(void);
void CloseRuntimeLink(void);

#ifdef __cplusplus
}
#endif

#endif
